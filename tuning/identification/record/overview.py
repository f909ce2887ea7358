"""Overview of a record in words: what it holds, and what it lacks for which fit."""

from typing import Any

import numpy as np

from tuning.identification.record.flight_record import CHANNELS, FlightRecord
from tuning.identification.record.uniform import Flight, missing_for, uniform

PURPOSES = {
    "steady": "drag, mass; a glide in balance",
    "driven": "the same through the turns, pitch as recorded",
    "closed": "moments too: pitch from the moving mass, the full plant",
}
"""Knowledge that each fit gives."""


def overview(record: FlightRecord) -> dict[str, Any]:
    """Plain numbers and sentences about a record.

    Args:
        record: record as `read_record` gives it.
    """
    begin, end = record.span()
    lacking = missing_for(record)
    flight, why_not = _flight(record)
    return {
        "name": record.name,
        "kind": record.kind,
        "sha256": record.digest,
        "duration_s": end - begin,
        "channels": {
            name: {
                "unit": CHANNELS[name][0],
                "count": len(series),
                "interval_s": series.interval(),
                "low": float(series.values.min()),
                "median": float(np.median(series.values)),
                "high": float(series.values.max()),
            }
            for name, series in record.channels.items()
        },
        "findings": [
            {"channel": f.channel, "text": f.text, "warning": f.warning}
            for f in record.findings
        ],
        "missing": lacking,
        "flight": None if flight is None else _about(flight),
        "no_flight": why_not,
        "speed_is_recorded": record.has("speed"),
    }


def _flight(record: FlightRecord) -> tuple[Flight | None, str]:
    try:
        return uniform(record), ""
    except ValueError as error:
        return None, str(error)


def _about(flight: Flight) -> dict[str, Any]:
    return {
        "dives": flight.dives(),
        "deepest_m": float(flight.depth.max()),
        "compared_s": float(flight.good.sum() * flight.dt),
        "steady_s": float(flight.steady.sum() * flight.dt),
    }


def text_of(content: dict[str, Any]) -> str:
    """The overview for a terminal.

    Args:
        content: numbers and sentences from `overview`.
    """
    hours = content["duration_s"] / 3600.0
    lines = [f"{content['name']}: {content['kind']}, {hours:.2f} h", ""]
    lines.append(
        f"{'channel':<16}{'unit':<8}{'samples':>9}{'every [s]':>11}"
        f"{'low':>12}{'median':>12}{'high':>12}"
    )
    for name, c in content["channels"].items():
        lines.append(
            f"{name:<16}{c['unit']:<8}{c['count']:>9}{c['interval_s']:>11.3g}"
            f"{c['low']:>12.5g}{c['median']:>12.5g}{c['high']:>12.5g}"
        )
    flight = content["flight"]
    if flight is not None:
        lines += [
            "",
            f"{flight['dives']} dives, the deepest {flight['deepest_m']:.0f} m; "
            f"{flight['compared_s'] / 60:.0f} min can be compared, "
            f"{flight['steady_s'] / 60:.0f} of them in steady glides.",
        ]
    lines += [""]
    for finding in content["findings"]:
        mark = "! " if finding["warning"] else "- "
        lines.append(f"{mark}{finding['channel']}: {finding['text']}")
    lines += ["", *fits_text(content)]
    return "\n".join(lines)


def fits_text(content: dict[str, Any]) -> list[str]:
    """One line for each fit: possible, or what it lacks.

    Args:
        content: numbers and sentences from `overview`.
    """
    lines = []
    for kind, lacking in content["missing"].items():
        if lacking:
            lines.append(f"fit --kind {kind}: not possible, lacks {', '.join(lacking)}")
        elif content["flight"] is None:
            lines.append(f"fit --kind {kind}: not possible: {content['no_flight']}")
        else:
            lines.append(f"fit --kind {kind}: possible ({PURPOSES[kind]})")
    if not content["speed_is_recorded"]:
        lines.append(
            "speed: not recorded. Depth rate alone cannot tell drag from a tilted "
            "pitch sensor, so the speeds of a fit will be untested."
        )
    return lines
