"""The section of a campaign's report on flights of yos: their ends and their cost."""

from tuning.campaign.analysis.summary import CampaignSummary
from tuning.campaign.report.names import FLIGHTS, with_unit
from tuning.campaign.report.text import brackets, short
from tuning.reporting.tables import markdown_table

_STATISTICS = ("q05", "q50", "q95")


def flights_section(summary: CampaignSummary) -> list[str]:
    """Lines on the ends of the missions and on what operators look at; or none.

    Args:
        summary: summary of the campaign.
    """
    controllers = summary.controllers
    if not summary.has_flights:
        return []
    names = dict.fromkeys(name for of in controllers.values() for name in of.ends)
    ends = [
        [name, *(str(of.ends.get(name, 0)) for of in controllers.values())]
        for name in names
    ]
    rows = []
    for name in FLIGHTS:
        for label, of in controllers.items():
            spread = of.measures[name]
            cells = [
                f"{short(spread[q]['value'])} {brackets(spread[q]['interval'])}"
                for q in _STATISTICS
            ]
            mean = short(spread["mean"])
            rows.append([with_unit(name), label, mean, *cells])
    head = ["measure", "gains", "mean", "5 % below", "median", "95 % below"]
    return [
        "## How the missions ended\n",
        *markdown_table(["members", *controllers], ends, 1),
        "## What the flights were like\n",
        *markdown_table(head, rows, 2),
    ]
