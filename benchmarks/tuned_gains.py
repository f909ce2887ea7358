"""Make the gains that come with jaxglider: `python benchmarks/tuned_gains.py`.

Tunes the paper's controllers on every plant and case by `jaxglider tune`, and PID where
the mass obeys mechanics, and copies the gains into the package; the actuators are those
of the plant. FxTPPC-roll is left out: it was made for actuators that jump, and an
FxTPPC that steers by bank knows of the roll itself. Cases can be named to make a part
again.

Then, or with `--judge` at once, it writes a table of what the gains of the package are
worth beside the paper's on members that neither descent nor choice has seen, and one of
how far their actuators travel and what work they do; with
`--ticks` one of the same gains at half and twice the tick, and from starts 1e-10 m
apart. Run it in the folder above.
"""

import argparse
import itertools
import subprocess
import sys
from pathlib import Path
from typing import Any

from actuator_work import actuator_work

from jaxglider.files.user_law import label_of
from jaxglider.files.writing import replacing, write_text
from jaxglider.signals import CHANNEL_UNITS
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.cli.options.arguments import (
    CONTROLLERS,
    PAPER_CONTROLLERS,
    PLANTS,
    SCENARIOS,
)
from tuning.cli.session.jax_setup import start_jax
from tuning.evaluation.final_gradient import GradientProbe
from tuning.evaluation.held_out import Judge, compare_held_out
from tuning.evaluation.robustness import Robustness, judge_robustness
from tuning.problem.problem import TuningProblem
from tuning.problem.spec import ProblemSpec

PACKAGE = Path(__file__).parent.parent / "jaxglider" / "paper" / "tuned"
PAPER_BEST = {
    "switching": {"depth": 0.0995, "pitch": 0.0449, "heading": 0.1966},
    "waypoints": {"depth": 0.1340, "pitch": 0.1516, "heading": 0.1574},
}
"""L2[e] of the best average-tracking cell that the paper prints [m, rad, rad]."""
CASES = {
    "-".join(case): case
    for case in itertools.product(SCENARIOS, PLANTS, CONTROLLERS)
    if case[2] in PAPER_CONTROLLERS or (case[2] == "pid" and case[1] != "printed")
}
"""Scenario, plant and controller of each case, by name."""


def main() -> int:
    options = _parser().parse_args()
    for name in options.only or CASES:
        if name not in CASES:
            sys.stderr.write(f"{name} must be one of {', '.join(CASES)}.\n")
            return 2
        if options.judge or options.gradients or options.ticks:
            continue
        code = _tune(name, options.out / name, options.arguments)
        if code:
            return code
    start_jax(64, every_core=True)
    shipped = options.only or [name for name in CASES if _file(name).is_file()]
    if options.gradients:
        for name in shipped:
            _state_gradient(name)
        return 0
    if options.ticks:
        table = _tick_table({name: _at_ticks(name) for name in shipped})
    else:
        results = [_judge(name) for name in shipped]
        table = _table(results) + "\n" + _travel_table(results)
    write_text(options.out / ("ticks.md" if options.ticks else "tuned.md"), table)
    sys.stdout.write(table)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/tuned"))
    parser.add_argument("--only", nargs="+", metavar="SCENARIO-PLANT-CONTROLLER")
    parser.add_argument(
        "--judge", action="store_true", help="tune nothing, write the table alone"
    )
    parser.add_argument(
        "--ticks",
        action="store_true",
        help="tune nothing, write a table of the gains at half and twice the tick, and "
        "from other roundings",
    )
    parser.add_argument(
        "--gradients",
        action="store_true",
        help="tune nothing, write into each file what the gradient there is worth",
    )
    parser.add_argument(
        "arguments", nargs="*", help="of `jaxglider tune`, after `--`, for all cases"
    )
    return parser


def _words(name: str) -> tuple[str, ...]:
    """Words of the command that tunes a case."""
    scenario, plant, controller = CASES[name]
    words = ["tune", "--scenario", scenario, "--plant", plant]
    words += ["--controller", controller]
    return tuple(words)


def _file(name: str) -> Path:
    """The gains of a case in the package."""
    scenario, plant, controller = CASES[name]
    return PACKAGE / scenario / plant / f"{controller}.toml"


def _tune(name: str, out: Path, more: list[str]) -> int:
    how = ("--precision", "32", "--no-check", *more)
    words = (*_words(name), *how, "--out", str(out))
    command = (sys.executable, "-m", "tuning", *words)
    sys.stderr.write(f"{name}\n")
    done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    if done.returncode == 0:
        with replacing(_file(name)) as temporary:
            temporary.write_bytes((out / "gains.toml").read_bytes())
    return done.returncode


def _state_gradient(name: str) -> None:
    """Writes into a gains file what the gradient at its gains is worth."""
    scenario, plant, controller = CASES[name]
    spec = ProblemSpec.of_paper(scenario, plant, controller)
    problem = TuningProblem.of(spec)
    (gains,) = spec.case.resolve([str(_file(name))], [controller])
    statement = GradientProbe(problem)(spec.case.loop(gains)[1])
    sys.stderr.write(f"{name}: {statement.text()}\n")
    text = _file(name).read_text(encoding="utf-8")
    kept = [x for x in text.splitlines() if not x.startswith("gradient = ")]
    place = kept.index("[provenance]") + 1
    kept.insert(place, f'gradient = "{statement.text()}"')
    write_text(_file(name), "\n".join(kept) + "\n")


def _shipped(name: str) -> tuple[TuningProblem, ClosedLoop]:
    """The problem of a case, and the loop with the gains of the package."""
    scenario, plant, controller = CASES[name]
    sys.stderr.write(f"judging {name}\n")
    paper = ProblemSpec.of_paper(scenario, plant, controller)
    (gains,) = paper.case.resolve([str(_file(name))], [controller])
    return TuningProblem.of(paper), paper.case.loop(gains)[1]


def _at_ticks(name: str) -> Robustness:
    """The gains of the package at other ticks and from other roundings."""
    problem, tuned = _shipped(name)
    return judge_robustness(Judge(problem), tuned)


def _judge(name: str) -> dict[str, Any]:
    """The gains of the package against the paper's."""
    scenario, plant, controller = CASES[name]
    problem, tuned = _shipped(name)
    about: dict[str, Any] = {
        "scenario": scenario,
        "plant": plant,
        "controller": controller,
        "work": [actuator_work(loop) for loop in (problem.loop, tuned)],
    }
    judge = Judge(problem)
    verdict = compare_held_out(problem, judge(problem.loop), judge(tuned))
    return about | verdict.to_dict()


def _table(results: list[dict[str, Any]]) -> str:
    lines = [
        "| case | plant | law | depth [m] | pitch [rad] | heading [rad] | "
        "chattering, heading | left a funnel | past 90° | did not finish |",
        "|---|---|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for result in results:
        rows = result["held_out"]
        cells = [result["scenario"], result["plant"], label_of(result["controller"])]
        for channel in ("depth", "pitch", "heading"):
            row = rows[channel]["rms_error"]
            best = PAPER_BEST[result["scenario"]][channel]
            share = "-"
            if row["after"] is not None:
                share = f"{100.0 * (1.0 - row['after'] / best):.0f} %"
            cells.append(f"{_cell(row['before'])} → {_cell(row['after'])} ({share})")
        row = rows["heading"]["chattering"]
        cells.append(f"{_cell(row['before'])} → {_cell(row['after'])}")
        before, after = (result["counts"][x] for x in ("before", "after"))
        for count in ("outside_funnel", "capsized", "unfinished"):
            cells.append(
                f"{before[count]} → {after[count]} of {after['members']}"
                if count in after
                else "-"
            )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _travel_table(results: list[dict[str, Any]]) -> str:
    """Travel, mean of the held-out members, and work of the nominal run."""
    lines = [
        "| case | plant | law | pumped [kg] | mass along the axis [m] | "
        "mass angle [rad] | work of the pump [J] | work of the mass [J] |",
        "|---|---|---|---:|---:|---:|---:|---:|",
    ]
    for result in results:
        rows = result["held_out"]
        cells = [result["scenario"], result["plant"], label_of(result["controller"])]
        pairs = [
            *(
                (row["before"], row["after"])
                for row in (rows[x]["travel"] for x in rows)
            ),
            *zip(*result["work"], strict=True),
        ]
        cells += [f"{_cell(before)} → {_cell(after)}" for before, after in pairs]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _tick_table(results: dict[str, Robustness]) -> str:
    """Means of the held-out members at each tick, and what is marked."""
    lines = [
        "| case | plant | law | channel | half the tick | the tick | twice the tick | "
        "over roundings | marked |",
        "|---|---|---|---|---:|---:|---:|---|---|",
    ]
    for name, found in results.items():
        scenario, plant, controller = CASES[name]
        for channel, unit in CHANNEL_UNITS.items():
            figures = [_cell(at["held_out"][channel]) for at in found.ticks.values()]
            ends = found.roundings["held_out"][channel]
            span = "-" if ends is None else f"{_cell(ends[0])} to {_cell(ends[1])}"
            figure = f"held_out.{channel}"
            marks = [
                word
                for word, names in (
                    ("depends on the tick", found.tick_dependent),
                    ("not reproducible", found.not_reproducible),
                )
                if figure in names
            ]
            cells = [scenario, plant, label_of(controller), f"{channel} [{unit}]"]
            cells += [*figures, span, ", ".join(marks) or "–"]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


if __name__ == "__main__":
    sys.exit(main())
