"""Names of results in the tables of a campaign's report."""

from jaxglider.signals import CHANNELS, COMMAND_UNITS
from tuning.campaign.analysis.rank_correlations import LEFT, SEVERITY
from tuning.campaign.run.rows import unit
from tuning.reporting.tables import OUTSIDE, RMS_COMMAND, RMS_ERROR, RMS_STEP

_OF_CHANNEL = {
    "rms_error": RMS_ERROR,
    "max_error_settled": "largest error once settled",
    "rms_effort": RMS_COMMAND,
    "chattering": RMS_STEP,
    "travel": "travel",
    "time_outside_funnel": OUTSIDE,
}
_OF_FLIGHT = {
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
ERRORS = (*(f"{c}.{m}" for c in CHANNELS for m in _OF_CHANNEL), "max_roll")
"""Results that the table of errors has."""
DEPTH_ERRORS = (
    "depth.rms_error",
    "depth.max_error_settled",
    "depth.time_outside_funnel",
)
"""Results that say nothing of yos: a glider that flies them tracks no depth."""
FLIGHTS = tuple(f"flight.{name}" for name in _OF_FLIGHT)
"""Results that the table of flights has."""
NAMED = {
    **{
        f"{c}.{m}": f"{c} {title}" for c in CHANNELS for m, title in _OF_CHANNEL.items()
    },
    **dict(zip(FLIGHTS, _OF_FLIGHT.values(), strict=True)),
    "max_roll": "largest roll",
    LEFT: "leaving a specified funnel",
    SEVERITY: "severity",
}
"""Names in words."""


def with_unit(name: str) -> str:
    """Name of a result in words, with its unit if it has one.

    Args:
        name: name of its column.
    """
    of = unit(name)
    return NAMED.get(name, name) + ("" if of == "1" else f" [{of}]")
