"""Report of tuning: before against after, on members it never saw."""

import csv
import io
from pathlib import Path
from typing import Any

from jaxglider.files.user_law import label_of
from jaxglider.files.writing import write_text
from jaxglider.plotting.save import save
from jaxglider.signals import CHANNEL_UNITS
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import Trajectory
from tuning.evaluation.figures import gains_of, tuning_figures
from tuning.evaluation.held_out import MEASURES
from tuning.evaluation.sections import (
    adversarial_line,
    adversarial_section,
    ledger_section,
    robust_section,
    specified_section,
)
from tuning.evaluation.settling_table import settling_table
from tuning.problem.problem import TuningProblem
from tuning.reporting.html import write_html
from tuning.reporting.ledger import text_ledger
from tuning.reporting.tables import figure, headline, outcome, unit_of
from tuning.search.settings import Step

_HELD_OUT = "The figures are of test members that neither descent nor choice has seen."
_SAME = "The figures are of the one case tuned on: nothing is held out."


def text_report(result: dict[str, Any], *, gains: bool = False) -> str:
    """The result for a terminal: what was seen, and the verdict at its end.

    Args:
        result: content of tune.json.
        gains: whether to list the tuned numbers too; the gains file has them.
    """
    lines = list(text_ledger(result["ledger"]["after"]))
    lines += [f"nominal {n}: {outcome(run)}" for n, run in result["nominal"].items()]
    if gains:
        lines += [
            f"{name:<42}{gain['before']:>12.5g} -> {gain['after']:<12.5g}"
            for name, gain in result["gains"].items()
        ]
    lines += ["", *_verdict(result), *adversarial_line(result["adversarial"])]
    return "\n".join(lines)


def _verdict(result: dict[str, Any]) -> list[str]:
    """The comparison on members held out, line by line."""
    members = result["members"]
    lines = [
        f"{result['controller']}, {result['scenario']} on {result['plant']}: "
        f"{result['method']}, {result['steps']} steps "
        f"({result['refused']} refused) on "
        f"{members['training']} members, {result['seconds']:.0f} s",
        _judged_on(members),
        f"{'':<16}"
        + "".join(f"{m:>22}" for m in MEASURES.values())
        + f"{'better':>10}",
    ]
    for channel, unit in CHANNEL_UNITS.items():
        cells = ""
        for measure in MEASURES:
            row = result["held_out"][channel][measure]
            cells += f"{_arrow(row['before'], row['after']):>22}"
        row = result["held_out"][channel]["rms_error"]
        cells += f"{row['better']:>5}/{row['pairs']}"
        lines.append(f"{f'{channel} [{unit}]':<16}{cells}")
    for name, counts in result["counts"].items():
        lines.append(
            f"{name:>7}: {counts['outside_funnel']} left a specified funnel, "
            f"{counts['capsized']} rolled past 90 deg, "
            f"{_unfinished(counts)}{counts['not_finite']} failed, "
            f"{counts['broken']['any']} broke the specification"
        )
    return lines


def _unfinished(counts: dict[str, Any]) -> str:
    """For yos, with how their missions ended, and for courses with waypoints."""
    if "unfinished" not in counts:
        return ""
    ends = ", ".join(f"{k} {name}" for name, k in counts.get("ends", {}).items())
    return f"{counts['unfinished']} did not finish{f' ({ends})' if ends else ''}, "


def _judged_on(members: dict[str, int]) -> str:
    if members["training"] == 1:
        return "the nominal case, the very one tuned on:"
    return f"held-out test, {members['test']} members:"


def _arrow(before: float | None, after: float | None) -> str:
    return f"{figure(before)} -> {figure(after)}"


def history_table(problem: TuningProblem, history: list[Step]) -> str:
    """The descent as CSV: one row a step, gains in their own units."""
    table = io.StringIO()
    rows = csv.writer(table)
    head = ["step", "objective", "validation", "refused", "best", "learning_rate"]
    rows.writerow([*head, *problem.space.names])
    for step in history:
        gains = problem.space.values(problem.space.write(problem.loop, step.free))
        rows.writerow(
            [
                step.number,
                step.loss,
                step.validation,
                int(step.refused),
                int(step.best),
                step.learning_rate,
                *gains.values(),
            ]
        )
    return table.getvalue()


def write_tuning_report(
    out: Path,
    problem: TuningProblem,
    history: list[Step],
    result: dict[str, Any],
    tuned: ClosedLoop,
    runs: dict[str, Trajectory],
) -> None:
    """Write report.md, its figures, and report.html, which has all of it.

    Args:
        out: folder to write to.
        problem: problem that was solved.
        history: steps of the search.
        result: content of tune.json.
        tuned: closed loop with the tuned gains.
        runs: nominal runs `before` and `after`, on the host.
    """
    title = f"{problem.spec.case.headline}, {label_of(problem.spec.controller)}"
    gains = gains_of(problem, history)
    for name, drawn in tuning_figures(title, history, gains, runs):
        save(drawn, out / f"{name}.png")
    text = _markdown(result, settling_table(tuned, runs))
    write_text(out / "report.md", text)
    write_html(out / "report.html", text, result.get("provenance", {}))


def _markdown(result: dict[str, Any], settling: list[str]) -> str:
    lines = [
        f"# Tuning {result['controller']}: {_flown(result)}\n",
        f"{result['steps']} steps, {result['refused']} refused, "
        f"{result['seconds']:.0f} s. The gains are those best on the validation "
        f"members. {_HELD_OUT if result['members']['training'] > 1 else _SAME}\n",
    ]
    lines += [f"> {text}" for text in result["notes"]]
    lines += [
        f"\n## {_judged_on(result['members'])[:-1].capitalize()}\n",
        "| channel | measure | before | after | difference | 95 % interval | better |",
        "|---|---|---:|---:|---:|---|---:|",
    ]
    for channel in CHANNEL_UNITS:
        for measure, title in MEASURES.items():
            unit = unit_of(channel, measure)
            row = result["held_out"][channel][measure]
            span = row["interval"]
            words = "-" if span is None else f"[{span[0]:.3g}, {span[1]:.3g}]"
            lines.append(
                f"| {channel} [{unit}] | {title} | {_cell(row['before'])} | "
                f"{_cell(row['after'])} | {_cell(row['difference'])} | {words} | "
                f"{row['better']}/{row['pairs']} |"
            )
    lines.append("")
    for name, counts in result["counts"].items():
        lines.append(
            f"- {name}: of {counts['members']} members {counts['outside_funnel']} left "
            f"a funnel at some time, {counts['capsized']} rolled past 90 degrees, "
            f"{_unfinished(counts)}{counts['not_finite']} became non-finite"
        )
    lines += specified_section(result["counts"])
    lines += ledger_section(result["ledger"])
    lines += robust_section(result["robustness"])
    lines += adversarial_section(result["adversarial"])
    lines += ["\n## Nominal case\n"]
    lines += [f"- {name}: {outcome(run)}" for name, run in result["nominal"].items()]
    if settling:
        lines += ["\n## Settling\n", *settling]
    lines += ["\n## Gains\n", "| gain | before | after |", "|---|---:|---:|"]
    for name, gain in result["gains"].items():
        lines.append(f"| `{name}` | {gain['before']:.6g} | {gain['after']:.6g} |")
    lines += [
        "\n![objective](objective.png)\n",
        "![gains](gains.png)\n",
        "![errors](errors.png)",
    ]
    return "\n".join(lines) + "\n"


def _flown(result: dict[str, Any]) -> str:
    """Case, vehicle and plant, for the title."""
    return headline(result["scenario"], result.get("vehicle", ""), result["plant"])


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
