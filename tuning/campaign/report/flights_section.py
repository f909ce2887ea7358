"""The section of a campaign's report on flights of yos: their ends and their cost."""

from jaxglider.signals import COMMAND_UNITS
from tuning.campaign.analysis.summary import CampaignSummary
from tuning.campaign.report.text import brackets, short
from tuning.campaign.run.rows import unit
from tuning.reporting.tables import markdown_table

_TITLES = {
    "total_energy": "energy",
    "energy.pump": "energy of the pump",
    "energy.position": "energy of the moving mass",
    "energy.steering": "energy of the steering",
    "energy_per_made_good": "energy per way made good",
    "energy_per_through_water": "energy per way through the water",
    "made_good": "way made good",
    "dive_time": "duration of a dive",
    "climb_time": "duration of a climb",
    "overshoot": "overshoot at the apogee",
    "depth_rate": "depth rate",
    "pitch_error": "pitch error, rms",
    "heading_error": "heading error, rms",
    "on_heading": "time within 10 deg of the heading",
    "strokes": "strokes of the pump",
    "pushed": "ballast pushed out",
    **{f"moves.{name}": f"moves, {name.replace('_', ' ')}" for name in COMMAND_UNITS},
    **{f"travel.{name}": f"travel, {name.replace('_', ' ')}" for name in COMMAND_UNITS},
}
_STATISTICS = ("q05", "q50", "q95")


def flights_section(summary: CampaignSummary) -> list[str]:
    """Lines on the ends of the missions and on what operators look at; or none.

    Args:
        summary: summary of the campaign.
    """
    controllers = summary.controllers
    if not any(of.ends for of in controllers.values()):
        return []
    names = dict.fromkeys(name for of in controllers.values() for name in of.ends)
    ends = [
        [name, *(str(of.ends.get(name, 0)) for of in controllers.values())]
        for name in names
    ]
    rows = []
    for name, title in _TITLES.items():
        column = f"flight.{name}"
        for label, of in controllers.items():
            spread = of.measures[column]
            cells = [
                f"{short(spread[q]['value'])} {brackets(spread[q]['interval'])}"
                for q in _STATISTICS
            ]
            mean = short(spread["mean"])
            rows.append([f"{title} [{unit(column)}]", label, mean, *cells])
    head = ["measure", "gains", "mean", "5 % below", "median", "95 % below"]
    return [
        "## How the missions ended\n",
        *markdown_table(["members", *controllers], ends, 1),
        "## What the flights were like\n",
        *markdown_table(head, rows, 2),
    ]
