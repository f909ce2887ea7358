"""The report of a campaign: how likely is trouble, what drives it, in tables."""

from pathlib import Path
from typing import Any

from jaxglider.files.writing import write_text
from jaxglider.plotting.save import save
from tuning.campaign.analysis.ribbons import ribbons
from tuning.campaign.analysis.summary import CampaignSummary
from tuning.campaign.report.draw import campaign_figures
from tuning.campaign.report.flights_section import flights_section
from tuning.campaign.report.names import DEPTH_ERRORS, ERRORS, NAMED, with_unit
from tuning.campaign.report.sensitivity_section import blamed
from tuning.campaign.report.specified_section import specified_section
from tuning.campaign.report.text import brackets, in_interval, short, told
from tuning.campaign.run.campaign import Campaign
from tuning.campaign.run.rows import Rows
from tuning.reporting.html import write_html
from tuning.reporting.tables import markdown_table


def write_campaign_report(
    folder: Path, campaign: Campaign, table: Rows, summary: CampaignSummary
) -> None:
    """Write report.md, its figures, and report.html, which has all of it.

    Args:
        folder: folder of the campaign.
        campaign: campaign it is about.
        table: rows of the campaign.
        summary: summary of the rows.
    """
    names = _figures(folder / "figures", campaign, table, summary)
    parts = [_head(summary), *_likely(summary), *_required(summary)]
    parts += specified_section(summary)
    parts += flights_section(summary)
    parts += [_picture("convergence"), *_measures(summary), _picture("distributions")]
    parts += [*_compared(summary), *_failed(summary), *_driven(summary)]
    parts += blamed(summary)
    parts += [_picture(n) for n in names if n not in ("convergence", "distributions")]
    text = "\n".join(parts) + "\n"
    write_text(folder / "report.md", text)
    write_html(folder / "report.html", text, summary.provenance)


def _head(summary: CampaignSummary) -> str:
    uncertainty = summary.uncertainty
    how = (
        "Masses, inertias and hydrodynamic coefficients differ by up to "
        f"±{100 * uncertainty:g} %, evenly, and so do the amplitudes of the waves; "
        "their phases are free."
        if isinstance(uncertainty, float)
        else "What is uncertain, and how, is in `campaign.json`."
    )
    exact = (
        ""
        if summary.design == "monte-carlo"
        else f" Members are placed by {summary.design}, more evenly than at random: "
        "the intervals are then usually too wide."
    )
    return (
        f"# How sure: {summary.headline}\n\n"
        f"{summary.members} members, the same for every set of gains. {how} All "
        "are judged by one specification, whatever their own funnels are. A run that "
        "became non-finite counts as every kind of trouble and as worse than any "
        "other. "
        f"Brackets are {100 * summary.confidence:g} % intervals: exact ones "
        "(Clopper and Pearson) of probabilities, order statistics of quantiles."
        f"{exact}\n"
    )


def _likely(summary: CampaignSummary) -> list[str]:
    controllers = summary.controllers
    rows = [
        [title.strip()]
        + [in_interval(c.probabilities[name]) for c in controllers.values()]
        for name, title in told(summary).items()
    ]
    return ["## How likely is trouble\n", *markdown_table(["", *controllers], rows, 1)]


def _required(summary: CampaignSummary) -> list[str]:
    if not summary.requirements:
        return []
    rows = [
        [
            f"`{entry['requirement']}`",
            entry["controller"],
            entry["verdict"],
            f"{short(entry['estimate'])} {brackets(entry['interval'])}",
        ]
        for entry in summary.requirements
    ]
    head = ["requirement", "gains", "verdict", "estimate"]
    return ["## Requirements\n", *markdown_table(head, rows, 3)]


def _left_out(summary: CampaignSummary) -> tuple[str, ...]:
    """Results that say nothing in a campaign."""
    return DEPTH_ERRORS if summary.has_flights else ()


def _measures(summary: CampaignSummary) -> list[str]:
    rows = []
    for name in (n for n in ERRORS if n not in _left_out(summary)):
        for label, controller in summary.controllers.items():
            spread = controller.measures[name]
            cells = [
                f"{short(spread[q]['value'])} {brackets(spread[q]['interval'])}"
                for q in ("q50", "q95", "cvar95")
            ]
            rows.append([with_unit(name), label, *cells, short(spread["worst"])])
    head = ["measure", "gains", "median", "95 % below", "mean of worst 5 %", "worst"]
    return ["## How large are the errors\n", *markdown_table(head, rows, 2)]


def _compared(summary: CampaignSummary) -> list[str]:
    parts = []
    for pair in summary.paired:
        event = pair["violation"]
        parts.append(f"## {pair['second']} against {pair['first']}\n")
        parts.append(
            f"On the same members, {event['only_first']} left a specified funnel with "
            f"{pair['first']} alone, {event['only_second']} with {pair['second']} "
            f"alone (difference {event['difference']:+.4f}, McNemar's exact p = "
            f"{event['p_value']:.2g}).\n"
        )
        rows = [
            [
                with_unit(name),
                f"{short(measure['difference'])} {brackets(measure['interval'])}",
                f"{short(measure['win_rate'])} {brackets(measure['win_interval'])}",
            ]
            for name, measure in pair["measures"].items()
            if name not in _left_out(summary)
        ]
        head = ["measure", "mean difference", f"{pair['second']} lower"]
        parts += markdown_table(head, rows, 1)
    return parts


def _failed(summary: CampaignSummary) -> list[str]:
    parts = []
    for label, controller in summary.controllers.items():
        failed = controller.failed_members
        if failed:
            listed = ", ".join(str(n) for n in failed[:20])
            more = f" and {len(failed) - 20} more (summary.json)" * (len(failed) > 20)
            parts.append(f"- {label}: not finite in members {listed}{more}")
        parts.append(
            f"- {label}: worst member {controller.worst_member}, median "
            f"{controller.median_member}; `jaxglider rerun` shows them"
        )
    return ["## Members to look at\n", *parts, ""]


def _driven(summary: CampaignSummary) -> list[str]:
    rows = [
        [label, NAMED.get(output, output), _strongest(ranked)]
        for label, controller in summary.controllers.items()
        for output, ranked in controller.rank_correlations.items()
    ]
    return [
        "## What drives it\n",
        "Rank correlation of what was drawn with what came of it, strongest first. "
        "The severity is the largest error over the edge of its funnel.\n",
        *markdown_table(["gains", "of", "with"], rows, 3),
    ]


def _strongest(ranked: list[dict[str, Any]]) -> str:
    """The strongest correlations with a result, in words."""
    leading = [f"{e['quantity']} {e['rho']:+.2f}" for e in ranked[:4] if e["rho"]]
    constant = "the same in every member" if ranked else "-"
    return ", ".join(leading) or constant


def _picture(name: str) -> str:
    return f"![{name}](figures/{name}.png)\n"


def _figures(
    folder: Path, campaign: Campaign, table: Rows, summary: CampaignSummary
) -> list[str]:
    """Draw; the names of the figures."""
    folder.mkdir(parents=True, exist_ok=True)
    shown = [
        ribbons(campaign, number, len(table), of.worst_member)
        for number, of in enumerate(summary.controllers.values())
    ]
    quantities = campaign.uncertainty.quantities
    units = {
        name: of.unit
        for name, of in zip(campaign.uncertainty.names(), quantities, strict=True)
    }
    names = []
    for name, figure in campaign_figures(units, table, summary, shown):
        save(figure, folder / f"{name}.png")
        names.append(name)
    return names
