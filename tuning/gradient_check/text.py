"""Gradient reports and comparisons as text and as plain numbers."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from tuning.gradient_check.check import GradientReport
from tuning.gradient_check.comparison import Comparison
from tuning.gradient_check.probe import REALISTIC, percent


def render(report: GradientReport) -> str:
    """The report as a text table.

    Args:
        report: report of `check_gradient`.
    """
    columns = [k for k, h in enumerate(report.steps) if h >= REALISTIC]
    titles = ["gradient", "error", *(percent(report.steps[k]) for k in columns)]
    wide = max(len("gain"), *(len(name) for name in report.names))
    lines = [
        f"J = {report.value:.6g}, rounding noise {report.noise:.1e}. Under a step: the "
        "true over the predicted change of J, 1 is perfect.",
        f"{'gain':<{wide}}" + "".join(f"{t:>12}" for t in [*titles, "saturated"]),
    ]
    for i, name in enumerate(report.names):
        cells = [f"{report.gradient[i]:.4g}", f"{report.error[i]:.1e}"]
        cells += [f"{report.prediction[k, i]:.3g}" for k in columns]
        cells += [_figure(report.saturated[i], percent)]
        row = "".join(f"{cell:>12}" for cell in cells)
        lines.append(f"{name:<{wide}}{row}  {report.verdicts[i]}")
    lines.append(f"{_norms(report)}\n{report.verdict}")
    return "\n".join(lines)


def markdown(report: GradientReport) -> list[str]:
    """The report in Markdown: what it says of all, and a table of the gains.

    Args:
        report: report of `check_gradient`.
    """
    columns = [k for k, h in enumerate(report.steps) if h >= REALISTIC]
    steps = [percent(report.steps[k]) for k in columns]
    rows = [
        [
            f"`{name}`",
            f"{report.gradient[i]:.4g}",
            f"{report.error[i]:.1e}",
            *(_figure(report.prediction[k, i], "{:.3g}".format) for k in columns),
            _figure(report.saturated[i], percent),
            str(report.verdicts[i]),
        ]
        for i, name in enumerate(report.names)
    ]
    head = ["gain", "gradient", "error", *steps, "saturated"]
    return [
        f"Verdict: {report.verdict}; {_norms(report)}.\n",
        f"J = {report.value:.6g}, rounding noise {report.noise:.1e}. Error: reverse "
        "mode against differences. Under a step: the true over the predicted change of "
        "J, 1 is perfect. Saturated: share of the time that the channel's actuator is "
        "at its limit.\n",
        "| " + " | ".join([*head, "verdict"]) + " |",
        "|---|" + "---:|" * (len(head) - 1) + "---|",
        *("| " + " | ".join(row) + " |" for row in rows),
    ]


def _norms(report: GradientReport) -> str:
    here, *others = report.norms
    text = f"gradient norm {here:.3g}"
    if others:
        text += (
            f"; at {len(others)} copies scattered around it "
            f"{min(others):.3g} to {max(others):.3g}"
        )
    return text


def _figure(value: float, form: Callable[[float], str]) -> str:
    return form(value) if np.isfinite(value) else "-"


def to_dict(report: GradientReport) -> dict[str, Any]:
    """The report as plain numbers, lists and strings; None where not finite."""
    plain = _plain(dataclasses.asdict(report))
    del plain["kinds"], plain["verdicts"]
    plain["norms"] = _plain(report.norms)
    plain["verdicts"] = {
        name: {"kind": kind.value, "text": text}
        for name, kind, text in zip(
            report.names, report.kinds, report.verdicts, strict=True
        )
    }
    plain["verdict"] = {"kind": report.kind.value, "text": report.verdict}
    return dict(plain)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | tuple | list):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value


def render_comparison(comparison: Comparison) -> str:
    """A comparison as a text table."""
    lines = [f"{comparison.what:>16}{'J':>12}{'|gradient|':>12}{'alignment':>12}"]
    rows = zip(
        comparison.at,
        comparison.values,
        comparison.norms,
        comparison.alignment,
        strict=True,
    )
    for at, value, norm, cosine in rows:
        lines.append(f"{at:>16.4g}{value:>12.5g}{norm:>12.4g}{cosine:>12.3f}")
    return "\n".join([*lines, comparison.verdict])


def comparison_to_dict(comparison: Comparison) -> dict[str, Any]:
    """A comparison as plain numbers, lists and strings; None where not finite."""
    plain = _plain(dataclasses.asdict(comparison))
    return {
        **plain,
        "norms": _plain(comparison.norms),
        "alignment": _plain(comparison.alignment),
    }
