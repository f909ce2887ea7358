"""The summary of a campaign as text for a terminal, and its numbers as cells."""

from typing import Any

from jaxglider.signals import CHANNEL_UNITS, COMMAND_UNITS
from tuning.campaign.analysis.requirements import ENDS
from tuning.campaign.analysis.summary import CampaignSummary, ControllerSummary

LINES = {
    "p_violation": "left a specified funnel",
    "p_violation_depth": "  depth",
    "p_violation_pitch": "  pitch",
    "p_violation_heading": "  heading",
    "p_capsize": "rolled past 90 deg",
    "p_unfinished": "did not finish",
    "p_bottom": "  met the bottom",
    "p_hover": "  hung at one depth",
    "p_stall": "  got no farther",
    "p_battery_empty": "  battery empty",
    "p_failure": "not finite",
}


def told(summary: CampaignSummary) -> dict[str, str]:
    """Titles of the probabilities that mean something in a campaign, by their names."""
    flights = summary.has_flights
    # A glider whose ballast is set once per phase tracks no depth.
    left_out = {"p_violation_depth"} if flights else set(ENDS)
    if not (summary.has_waypoints or flights):
        left_out.add("p_unfinished")
    return {name: title for name, title in LINES.items() if name not in left_out}


def text_summary(summary: CampaignSummary) -> str:
    """The summary as a table for a terminal."""
    controllers = summary.controllers
    uncertainty = summary.uncertainty
    half = (
        f"{100 * uncertainty:g} %" if isinstance(uncertainty, float) else "from a file"
    )
    rows = [["probability", *controllers]]
    for name, title in told(summary).items():
        entries = [of.probabilities[name] for of in controllers.values()]
        if name in ENDS and not any(entry["k"] for entry in entries):
            continue
        rows.append([title, *map(in_interval, entries)])
    rows += _specified(controllers)
    rows.append(["95 % of members below"])
    every = list(controllers.values())
    for channel, unit in CHANNEL_UNITS.items():
        if channel == "depth" and summary.has_flights:
            continue
        name = f"{channel}.rms_error"
        entries = [of.measures[name]["q95"] for of in controllers.values()]
        rows.append([f"  {channel} rms error [{unit}]", *map(_quantile, entries)])
    for channel, command in zip(CHANNEL_UNITS, COMMAND_UNITS, strict=True):
        name = f"{channel}.travel"
        if any(name not in of.measures for of in every):
            continue
        entries = [of.measures[name]["q95"] for of in every]
        title = f"  {command.replace('_', ' ')} travel [{COMMAND_UNITS[command]}]"
        rows.append([title, *map(_quantile, entries)])
    if summary.has_flights:
        name = "flight.energy_per_through_water"
        entries = [of.measures[name]["q95"] for of in controllers.values()]
        rows.append(["  energy [kJ/km]", *map(_quantile, entries)])
    lines = [
        f"{summary.members} members, {summary.scenario} on {summary.plant}, "
        f"uncertainty {half}, {100 * summary.confidence:g} % intervals",
        *_aligned(rows),
    ]
    for label, controller in controllers.items():
        lines.append(
            f"{label}: worst member {controller.worst_member}, "
            f"median {controller.median_member}"
        )
        if controller.ends:
            counts = ", ".join(f"{n} {name}" for name, n in controller.ends.items())
            lines.append(f"{label}: {counts}")
        if controller.not_flown:
            lines.append(
                f"{label}: {controller.not_flown} members flew nothing, their last "
                "waypoint is reached where they start: their zeros count above"
            )
    for entry in summary.requirements:
        lines.append(
            f"{entry['requirement']}: {entry['verdict']} by {entry['controller']} "
            f"({short(entry['estimate'])} {brackets(entry['interval'])})"
        )
    return "\n".join(lines)


def _specified(controllers: dict[str, ControllerSummary]) -> list[list[str]]:
    """Rows on the specification as a whole and on the theorem's assumptions."""
    first = next(iter(controllers.values()))
    rows = []
    if first.broken:
        entries = [of.broken["any"] for of in controllers.values()]
        rows.append(["broke the specification", *map(in_interval, entries)])
        if "bank" in first.broken:
            entries = [of.broken["bank"] for of in controllers.values()]
            rows.append(["  bank limit", *map(in_interval, entries)])
    names = dict.fromkeys(name for of in controllers.values() for name in of.ledger)
    if names:
        rows.append(["assumption holds"])
    for name in names:
        cells = [
            in_interval(of.ledger[name]["holds"]) if name in of.ledger else "-"
            for of in controllers.values()
        ]
        rows.append([f"  {name}", *cells])
    return rows


def _aligned(rows: list[list[str]]) -> list[str]:
    """Lines of a table: titles to the left, the rest to the right."""
    wide = 2 + max(len(cell) for row in rows for cell in row[1:])
    lines = [f"{row[0]:<30}" + "".join(f"{x:>{wide}}" for x in row[1:]) for row in rows]
    return [line.rstrip() for line in lines]


def in_interval(estimate: dict[str, Any]) -> str:
    """A probability with its interval."""
    low, high = estimate["interval"]
    return f"{estimate['p']:.4g} [{low:.4g}, {high:.4g}]"


def _quantile(estimate: dict[str, Any]) -> str:
    return f"{short(estimate['value'])} {brackets(estimate['interval'])}"


def brackets(interval: list[Any] | None) -> str:
    """An interval; in words where the members are too few for one end or both."""
    if interval is None:
        return ""
    if all(x is None for x in interval):
        return "[too few members]"
    ends = ("no bound" if x is None else f"{x:.3g}" for x in interval)
    return f"[{', '.join(ends)}]"


def short(value: float | None) -> str:
    """A number in a table; a dash for none."""
    return "-" if value is None else f"{value:.3g}"
