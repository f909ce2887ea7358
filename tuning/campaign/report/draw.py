"""All figures of a campaign, made one after the other."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from jaxglider.plotting.style import (
    COLUMN,
    PAGE,
    legend_above,
    look,
    new_figure,
    styles,
)
from tuning.campaign.analysis.rank_correlations import SEVERITY
from tuning.campaign.analysis.ribbons import Ribbons
from tuning.campaign.analysis.summary import CampaignSummary, severity
from tuning.campaign.report import figures
from tuning.campaign.report.sensitivity_section import sobol_figure
from tuning.campaign.run.rows import Rows

_TOP = 8
"""Uncertain numbers that bars are drawn of."""


def campaign_figures(
    units: Mapping[str, str],
    table: Rows,
    summary: CampaignSummary,
    shown: Sequence[Ribbons],
) -> Iterator[tuple[str, Figure]]:
    """Name and figure, one at a time, what was flown above each.

    Args:
        units: unit of each number that differs from member to member, by its name.
        table: rows of the campaign.
        summary: summary of the rows.
        shown: errors over time, for each set of gains.
    """
    title = summary.headline
    with look():
        figure = new_figure(COLUMN, 2.8)
        figures.convergence(figure.subplots(), table)
        figure.suptitle(title, wrap=True)
    yield "convergence", figure
    with look():
        figure = new_figure(PAGE, 2.6)
        figures.distributions(figure.subplots(1, 3, sharey=True), table)
        figure.suptitle(title, wrap=True)
    yield "distributions", figure
    with look():
        figure = _scatter(units, table, summary)
        figure.suptitle(title, wrap=True)
    yield "scatter", figure
    with look():
        figure = _correlation_bars(summary)
        figure.suptitle(title, wrap=True)
    yield "rank_correlations", figure
    pairs = zip(summary.controllers.items(), styles(table.labels).values(), strict=True)
    for number, ((label, controller), style) in enumerate(pairs):
        if controller.sensitivity is not None:
            with look():
                figure = sobol_figure(controller.sensitivity)
                figure.suptitle(f"{title}, {label}", wrap=True)
            yield f"sobol_{number}", figure
        with look():
            figure = new_figure(COLUMN, 4.6)
            axes = figure.subplots(3, 1, sharex=True)
            figures.draw_ribbons(axes, shown[number], style.colour)
            figure.align_ylabels()
            figure.suptitle(f"{title}, {label}", wrap=True)
        yield f"ribbons_{number}", figure


def _scatter(units: Mapping[str, str], table: Rows, summary: CampaignSummary) -> Figure:
    """The severity against the number that drives it most, for each set of gains."""
    figure = new_figure(PAGE, 2.8)
    panels = figure.subplots(1, len(table.labels), squeeze=False)[0]
    for number, (label, style) in enumerate(styles(table.labels).items()):
        panels[number].set_title(label, loc="left")
        ranked = summary.controllers[label].rank_correlations[SEVERITY]
        if not ranked:
            continue
        worst = ranked[0]["quantity"]
        values = np.array(table.rows["values"][:, list(units).index(worst)])
        name = f"{worst} ({units[worst]})"
        figures.scatter(
            panels[number], values, name, severity(table, number), style.colour
        )
    return figure


def _correlation_bars(summary: CampaignSummary) -> Figure:
    """The strongest rank correlations with the severity, of every set of gains."""
    correlations = {
        label: {e["quantity"]: e for e in entry.rank_correlations[SEVERITY]}
        for label, entry in summary.controllers.items()
    }
    first = next(iter(correlations.values()))
    strongest = {q: max(abs(f[q]["rho"]) for f in correlations.values()) for q in first}
    names = sorted(strongest, key=lambda q: -strongest[q])[:_TOP]
    groups = {
        label: (
            np.array([entries[q]["rho"] for q in names]),
            np.array([entries[q]["interval"][0] for q in names]),
            np.array([entries[q]["interval"][1] for q in names]),
        )
        for label, entries in correlations.items()
    }
    figure = new_figure(COLUMN, 0.8 + 0.32 * len(names))
    axis = figure.subplots()
    colours = [style.colour for style in styles(correlations).values()]
    figures.bars(axis, names, groups, colours)
    axis.set_xlabel("rank correlation with the severity")
    legend_above(axis, axis.get_legend_handles_labels()[0])
    return figure
