"""Flights of yos as text: the mission as a whole, and dive by dive."""

import math
from collections.abc import Sequence
from typing import Any

from tuning.reporting.tables import DEGREE, decimals, markdown_table, text_columns

_HALVES = (
    # title, key, factor, digits
    ("time [s]", "duration_s", 1.0, 0),
    ("from [m]", "trigger_depth_m", 1.0, 1),
    ("over [m]", "overshoot_m", 1.0, 2),
    ("settled [s]", "settle_time_s", 1.0, 0),
    ("peak [deg]", "peak_pitch_rad", DEGREE, 1),
    ("pitch [deg]", "pitch_rad", DEGREE, 1),
    ("std [deg]", "pitch_deviation_rad", DEGREE, 1),
    ("heading rms [deg]", "heading_error_rad", DEGREE, 1),
    ("in 10 deg [%]", "on_heading", 100.0, 0),
    ("w [m/s]", "depth_rate_m_s", 1.0, 3),
    ("wanted", "wanted_depth_rate_m_s", 1.0, 3),
    ("way [m]", "made_good_m", 1.0, 0),
    ("energy [J]", "energy_J", 1.0, 0),
)
_IN_FILES = (
    *_HALVES,
    ("pump [J]", "pump_energy_J", 1.0, 0),
    ("moves", "mass_angle_moves", 1.0, 0),
    ("turned [deg]", "mass_angle_travel_rad", DEGREE, 0),
)
"""Columns of files, which may be wider than a terminal."""
_RANKED = (
    ("pitch rms [deg]", "pitch_error_rad", DEGREE, 2),
    ("heading rms [deg]", "heading_error_rad", DEGREE, 1),
    ("made good [m]", "made_good_m", 1.0, 0),
    ("energy [kJ]", "total_energy_J", 1e-3, 1),
    ("kJ/km", "energy_per_made_good_J_m", 1.0, 2),
)
_FAILED = "FAILED"
_METERED = ("total_energy_J", "energy_per_made_good_J_m")
_MOVED = {"mass_position": "mass moves/h", "mass_angle": "steering moves/h"}
_CONSUMERS = ("pump", "position", "steering", "hotel", "surface", "communication")
MOST = 12
"""Halves that a terminal is shown; files have all."""


def text_ranking(runs: list[dict[str, Any]]) -> str:
    """Several flights of one task side by side for a terminal, or nothing."""
    title, head, rows = _ranking(runs)
    if not rows:
        return ""
    left = max(len(row[0]) for row in rows) + 2
    return "\n".join([f"{title}:", *text_columns(head, rows, left)])


def markdown_ranking(runs: list[dict[str, Any]]) -> list[str]:
    """The same as Markdown."""
    title, head, rows = _ranking(runs)
    if not rows:
        return []
    return [f"\n### {runs[0]['scenario']}: {title}\n", *markdown_table(head, rows, 1)]


def _ranking(
    runs: list[dict[str, Any]],
) -> tuple[str, list[str], list[list[str]]]:
    """Title, heads and rows of the flights of one task, the thriftiest first."""
    flights = [run for run in runs if "flight" in run]
    if len(flights) < 2:
        return "", [], []
    metered = any((run["flight"]["total_energy_J"] or 0.0) > 0.0 for run in flights)
    first, words = "heading_error_rad", "the rms error of the heading"
    if metered:
        first, words = "energy_per_made_good_J_m", "energy per km made good"
    known = [c for c in _RANKED if metered or c[1] not in _METERED]

    def rank(run: dict[str, Any]) -> tuple[bool, float]:
        value = run["flight"][first]
        return not _is_whole(run), math.inf if value is None else value

    rows = []
    for run in sorted(flights, key=rank):
        flight, hours = run["flight"], (run["end_time_s"] or math.nan) / 3600.0
        moves = flight["moves"]
        cells = [decimals(flight[key], digits, f) for _, key, f, digits in known]
        cells += [decimals(moves[key], 0, 1.0 / hours) for key in _MOVED]
        if _end(run) == _FAILED:  # sums until then, and of nonsense
            cells = ["-"] * len(cells)
        rows.append([run["controller"], _end(run), *cells])
    heads = ["law", "end", *(title for title, *_ in known), *_MOVED.values()]
    return f"by {words}, those not completed last", heads, rows


def _is_whole(run: dict[str, Any]) -> bool:
    """Whether a run came to the end of its task upright."""
    return run.get("status", "completed") == "completed" and not _is_lost(run)


def _is_lost(run: dict[str, Any]) -> bool:
    return bool(run.get("failure") or not run["finite"] or run["capsized"])


def _end(run: dict[str, Any]) -> str:
    if run.get("failure") or not run["finite"]:
        return _FAILED
    return "ROLLED" if run["capsized"] else str(run.get("status", "flown"))


def text_flight(run: dict[str, Any]) -> str:
    """The flight of a run for a terminal, or nothing where none was measured."""
    if "flight" not in run:
        return ""
    lines = [*_mission(run), ""]
    titles, rows = _rows(run.get("halves", []), _HALVES)
    if rows:
        lines += text_columns(titles, rows[:MOST], 9)
        if len(rows) > MOST:
            lines.append(f"... and {len(rows) - MOST} more, in the files.")
    return "\n".join(lines)


def markdown_flight(run: dict[str, Any]) -> list[str]:
    """The same as Markdown, every half."""
    if "flight" not in run:
        return []
    lines = [f"\n### Flight of {run['scenario']}, {run['controller']}\n"]
    lines += [f"- {line}" for line in _mission(run)] + [""]
    titles, rows = _rows(run.get("halves", []), _IN_FILES)
    if rows:
        lines += markdown_table(titles, rows, 1)
    return lines


def _mission(run: dict[str, Any]) -> list[str]:
    f = _numbers(run["flight"])
    energy = ", ".join(f"{name} {f['energy_J'][name]:.0f}" for name in _CONSUMERS)
    moves, travel = f["moves"], f["travel"]
    lines = []
    # A schedule or a course whose energy is counted has neither phases nor an end.
    if "status" in run:
        lines.append(
            f"{run['status']}: {f['dives']:.0f} dives, {f['climbs']:.0f} climbs, "
            f"{f['surfacings']:.0f} surfacings, "
            f"{f['surface_time_s']:.0f} s at the surface"
        )
    lines += [
        f"made good {decimals(f['made_good_m'], 0)} m, through the water "
        f"{decimals(f['through_water_m'], 0)} m",
        f"pump: {f['strokes']:.0f} strokes, {f['pushed_kg']:.2f} kg pushed out; moves: "
        f"mass {moves['mass_position']:.0f} ({travel['mass_position']:.2f} m), "
        f"steering {moves['mass_angle']:.0f} "
        f"({travel['mass_angle'] * DEGREE:.0f} deg)",
    ]
    if f["total_energy_J"] > 0.0:
        lines.insert(
            -1,
            f"energy {f['total_energy_J'] / 1e3:.1f} kJ [J: {energy}]; "
            f"{decimals(f['energy_per_made_good_J_m'], 2)} kJ/km made good, "
            f"{decimals(f['energy_per_through_water_J_m'], 2)} through the water",
        )
    return lines


def _numbers(table: dict[str, Any]) -> dict[str, Any]:
    """The table with NaN for None, which stands for what a failed run has lost."""
    return {
        key: _numbers(value)
        if isinstance(value, dict)
        else (math.nan if value is None else value)
        for key, value in table.items()
    }


def _rows(
    halves: Sequence[dict[str, Any]], columns: Sequence[tuple[Any, ...]]
) -> tuple[list[str], list[list[str]]]:
    """Titles and rows; what no half has, such as a wanted depth rate, is left out."""
    known = [c for c in columns if any(half.get(c[1]) is not None for half in halves)]
    rows = [
        [
            f"{number // 2 + 1} {half['half']}",
            *(decimals(half.get(key), digits, f) for _, key, f, digits in known),
        ]
        for number, half in enumerate(halves)
    ]
    return ["half", *(title for title, *_ in known)], rows
