"""Flights of yos as text: the mission as a whole, and dive by dive."""

import math
from collections.abc import Sequence
from functools import reduce
from operator import getitem
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
_CONSUMERS = ("pump", "position", "steering", "hotel", "surface", "communication")
MOST = 12
"""Halves that a terminal is shown; files have all."""
FEW = 3
"""Flights that a terminal is shown one by one; of more it has the ranking alone."""
_RANKING = (
    # title, keys, factor, digits
    ("kJ/km made good", ("energy_per_made_good_J_m",), 1.0, 2),
    ("kJ/km in water", ("energy_per_through_water_J_m",), 1.0, 2),
    ("made good [m]", ("made_good_m",), 1.0, 0),
    ("heading rms [deg]", ("heading_error_rad",), DEGREE, 1),
    ("pitch rms [deg]", ("pitch_error_rad",), DEGREE, 1),
    ("w [m/s]", ("depth_rate_m_s",), 1.0, 3),
    ("pump [J]", ("energy_J", "pump"), 1.0, 0),
    ("moves of mass", ("moves", "mass_position"), 1.0, 0),
    ("of steering", ("moves", "mass_angle"), 1.0, 0),
)


_FAILED = "failed"


def text_ranking(runs: Sequence[dict[str, Any]]) -> str:
    """The flights of one task side by side for a terminal; nothing of a single one."""
    titles, rows = _ranked(runs)
    if not rows:
        return ""
    wide = max(len(row[0]) for row in rows) + 2
    return "\n".join([_ranked_by(runs), *text_columns(titles, rows, wide)])


def markdown_ranking(runs: Sequence[dict[str, Any]]) -> list[str]:
    """The same as Markdown."""
    titles, rows = _ranked(runs)
    if not rows:
        return []
    title = f"\n### Flights of {runs[0]['scenario']}, ranked\n"
    return [title, _ranked_by(runs), "", *markdown_table(titles, rows, 1)]


def _ranked_by(runs: Sequence[dict[str, Any]]) -> str:
    """A sentence on the order of the flights."""
    measure = "their energy for the way made good"
    if not _is_metered(runs):
        measure = "the error of their heading"
    return (
        f"Flights by {measure}; behind them those that ended otherwise, rolled past "
        "90 deg or failed."
    )


def _is_metered(runs: Sequence[dict[str, Any]]) -> bool:
    """Whether any of the flights has an energy for the way made good."""
    return any(
        run["flight"]["energy_per_made_good_J_m"] for run in runs if "flight" in run
    )


def _ranked(
    runs: Sequence[dict[str, Any]],
) -> tuple[list[str], list[list[str]]]:
    """Titles and rows of the flights, best first; no rows where less than two flew."""
    flown = [run for run in runs if "flight" in run]
    titles = ["law", *(title for title, *_ in _RANKING), "end"]
    if len(flown) < 2:
        return titles, []

    measure = "energy_per_made_good_J_m" if _is_metered(flown) else "heading_error_rad"

    def place(run: dict[str, Any]) -> tuple[bool, float]:
        cost = run["flight"][measure]
        return _how_it_ended(run) != "completed", math.inf if cost is None else cost

    rows = []
    for run in sorted(flown, key=place):
        end, cells = _how_it_ended(run), [run["controller"]]
        for _, keys, factor, digits in _RANKING:
            value = reduce(getitem, keys, run["flight"])
            # Until it failed: sums of nonsense.
            cells.append("-" if end == _FAILED else _short(value, digits, factor))
        rows.append([*cells, end])
    wide = max(len(row[-1]) for row in rows)
    return [*titles[:-1], f"{titles[-1]:>{wide}}"], rows


def _short(value: float | None, digits: int, factor: float) -> str:
    """A number with some decimals; of a glider flung far away, its size alone."""
    if value is not None and math.isfinite(value) and abs(factor * value) >= 1e6:
        return f"{factor * value:.1e}"
    return decimals(value, digits, factor)


def _how_it_ended(run: dict[str, Any]) -> str:
    """The end of a mission, unless the glider was lost on the way."""
    if run.get("failure") or not run["finite"]:
        return _FAILED
    if run["capsized"]:
        return "rolled over"
    return str(run.get("status", "completed"))


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
