"""The part of a report about sensitivities: tables, a figure, where ways differ."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from jaxglider.plotting.style import (
    PAGE,
    distinct_styles,
    in_words,
    legend_above,
    new_figure,
)
from tuning.campaign.analysis.rank_correlations import LEFT, SEVERITY
from tuning.campaign.analysis.summary import CampaignSummary
from tuning.campaign.report import figures
from tuning.campaign.report.text import brackets, short
from tuning.reporting.tables import markdown_table

_TOP = 8
LEAST_BLOCKS = 64
"""Number of blocks below which Sobol indices are withheld: their intervals would be
wider than what they say."""
_DRAWN = {LEFT: "leaving a funnel", SEVERITY: "the severity"}


def blamed(summary: CampaignSummary) -> list[str]:
    """The sensitivities of every set of gains, in Markdown; nothing where none are."""
    parts: list[str] = []
    for label, controller in summary.controllers.items():
        for output, one in (controller.sensitivity or {}).items():
            parts.append(f"### {label}: {output}\n")
            parts += _rows(one) + _words(one)
    if not parts:
        return []
    return [
        "## What is to blame\n",
        "Sobol indices: the share of the variance that goes when this number alone is "
        "known (first), and that stays when all others are (total). Gradient: the "
        "median over members of the derivative times the standard deviation of what "
        "is drawn. Blocks with a run that failed are left out of the indices, except "
        f"for `{LEFT}`. Of numbers that are correlated, the index is that of the "
        "independent score behind each.\n",
        *parts,
    ]


def _rows(one: dict[str, Any]) -> list[str]:
    rows = [
        [
            row["quantity"],
            _index(one, row, "total"),
            _index(one, row, "first"),
            "-" if row["rho"] is None else f"{row['rho']:+.2f}",
            short(row.get("gradient")),
        ]
        for row in one["rows"][:_TOP]
    ]
    head = ["number", "total index", "first index", "rank correlation", "gradient"]
    return markdown_table(head, rows, 1)


def withheld(one: dict[str, Any]) -> bool:
    """Whether an output has too few blocks for its Sobol indices to say anything.

    Args:
        one: sensitivities of one output.
    """
    return bool(one["blocks"] < LEAST_BLOCKS)


def _index(one: dict[str, Any], row: dict[str, Any], name: str) -> str:
    if name not in row:
        return "-"
    if withheld(one):
        return "withheld"
    return f"{row[name]:.2f} {brackets(row[f'{name}_interval'])}"


def _words(one: dict[str, Any]) -> list[str]:
    lines = [
        f"{one['blocks']} blocks, {one['blocks_left_out']} more left out. Agreement on "
        "the order (Spearman): "
        + "; ".join(f"{pair} {value:.2f}" for pair, value in one["agreement"].items())
        + "."
        if one["agreement"]
        else f"{one['blocks']} blocks, {one['blocks_left_out']} more left out."
    ]
    if withheld(one) and any("total" in row for row in one["rows"]):
        lines.append(
            f"Sobol indices are withheld: {one['blocks']} blocks are too few. Give "
            "--sensitivity 128 or more."
        )
    if one["disagreements"]:
        lines.append("They disagree: " + "; ".join(one["disagreements"]) + ".")
    return ["\n".join(lines) + "\n"]


def sobol_figure(sensitivity: dict[str, Any]) -> Figure:
    """Sorted bars of total and first indices, of leaving a funnel and how far.

    Args:
        sensitivity: sensitivities of one set of gains, by output.
    """
    figure = new_figure(PAGE, 3.2)
    panels = figure.subplots(1, len(_DRAWN))
    colours = [style.colour for style in distinct_styles(2)]
    for axis, (output, title) in zip(panels, _DRAWN.items(), strict=True):
        rows = [row for row in sensitivity[output]["rows"] if "total" in row]
        rows = rows[:_TOP]
        axis.set_xlabel(f"Sobol index of {title}")
        few = withheld(sensitivity[output])
        if few or not rows:
            axis.set_axis_off()
            why = "too few blocks" if few and rows else "nothing varies"
            axis.text(0.5, 0.5, f"{title}: {why}", ha="center")
            continue
        groups = {
            name: (
                np.array([row[name] for row in rows]),
                np.array([row[f"{name}_interval"][0] for row in rows]),
                np.array([row[f"{name}_interval"][1] for row in rows]),
            )
            for name in ("total", "first")
        }
        figures.bars(axis, [row["quantity"] for row in rows], groups, colours)
        # Too few blocks give intervals that would dwarf every bar.
        low, high = axis.get_xlim()
        axis.set_xlim(max(low, -0.5), min(high, 1.5))
        largest = groups["total"][0].max()
        if largest > 1.5:
            axis.set_title(f"up to {in_words(largest)}", loc="right", pad=3.0)
        legend_above(axis, axis.get_legend_handles_labels()[0])
    return figure
