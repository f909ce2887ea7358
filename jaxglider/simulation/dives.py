"""A flight dive by dive, as operators look at it; from a trajectory, on the host.

A half is a dive or a climb with the inflection that begins it. The pitch has settled at
the start of the first 60 s of which 80 % are within 3° of what is wanted.
"""

import itertools
import math
from typing import Any

import numpy as np

from jaxglider.guidance.phases import APOGEE, CLIMB, DIVE, INFLECTION, SURFACE
from jaxglider.simulation.rollout import Trajectory

WINDOW, SHARE, SETTLED = 60.0, 0.8, math.radians(3.0)
"""Length of the window [s], share of it, and error [rad] that tell a settled pitch."""
STEADY = 60.0
"""Time after an inflection from which pitch and depth rate count as steady [s]."""
BAND = math.radians(10.0)
"""Heading error within which a glider is on its heading [rad]."""

COLUMNS = {
    "duration_s": "s",
    "trigger_depth_m": "m",
    "overshoot_m": "m",
    "settle_time_s": "s",
    "peak_pitch_rad": "rad",
    "pitch_rad": "rad",
    "pitch_deviation_rad": "rad",
    "heading_error_rad": "rad",
    "on_heading": "1",
    "depth_rate_m_s": "m/s",
    "energy_J": "J",
    "pushed_kg": "kg",
    "mass_position_moves": "1",
    "mass_angle_moves": "1",
    "mass_angle_travel_rad": "rad",
}
"""Unit of each measure of a half."""


def halves(run: Trajectory) -> list[dict[str, Any]]:
    """Measures of each completed dive and climb, in order; none without phases.

    Args:
        run: trajectory with phases, on the host.
    """
    ticks = run.ticks
    if ticks.phase is None:
        return []
    active = np.asarray(ticks.active)
    count = int(np.argmin(active)) if not active.all() else len(active)
    phase = np.asarray(ticks.phase)[:count]
    starts = _starts(phase)
    rows = []
    for start, end in itertools.pairwise(starts):
        kind = _kind(phase[start])
        if kind is not None:
            rows.append(
                {"half": kind, "start_s": float(ticks.time[start])}
                | _measures(ticks, kind, slice(start, end), count)
            )
    return rows


def _starts(phase: np.ndarray) -> list[int]:
    """First ticks of the halves and of the stays at the surface."""
    first = np.isin(phase, (APOGEE, INFLECTION, SURFACE))
    changed = np.concatenate([[True], phase[1:] != phase[:-1]])
    return [int(n) for n in np.flatnonzero(first & changed)]


def _kind(phase: int) -> str | None:
    return {APOGEE: "climb", INFLECTION: "dive"}.get(int(phase))


def _measures(ticks: Any, kind: str, part: slice, count: int) -> dict[str, float]:
    """The measures of one half."""

    def of(column: Any) -> np.ndarray:
        return np.asarray(column, np.float64)[part]

    time = of(ticks.time) - float(ticks.time[part.start])
    depth, pitch = of(ticks.state.depth), of(ticks.state.pitch)
    gliding = np.asarray(ticks.phase)[part] == (DIVE if kind == "dive" else CLIMB)
    steady = gliding & (time > STEADY)
    error = of(ticks.error.heading)[gliding]
    beyond = depth[0] - depth.min() if kind == "dive" else depth.max() - depth[0]
    period = float(ticks.time[1] - ticks.time[0])
    peak = pitch.min() if kind == "dive" else pitch.max()
    ends = slice(part.start, min(part.stop + 1, count))
    return {
        "duration_s": len(time) * period,
        "trigger_depth_m": float(depth[0]),
        "overshoot_m": float(beyond),
        "settle_time_s": _settle_time(time, of(ticks.error.pitch), period),
        "peak_pitch_rad": float(peak),
        "pitch_rad": _mean(pitch[steady]),
        "pitch_deviation_rad": _deviation(pitch[steady]),
        "heading_error_rad": math.sqrt(_mean(error**2)) if error.size else math.nan,
        "on_heading": _mean(np.abs(error) <= BAND),
        "depth_rate_m_s": _slope(time[steady], depth[steady]),
        "energy_J": _spent(ticks, ends),
        **_moves(ticks, part),
    }


def _settle_time(time: np.ndarray, error: np.ndarray, period: float) -> float:
    width = max(1, round(WINDOW / period))
    inside = (np.abs(error) <= SETTLED).astype(float)
    if len(inside) < width:
        return math.nan
    shares = np.convolve(inside, np.ones(width) / width, "valid")
    # The window begins with a tick that is inside: outside nothing has settled.
    found = np.flatnonzero((shares >= SHARE - 1e-9) & (inside[: len(shares)] > 0.0))
    return float(time[found[0]]) if found.size else math.nan


def _moves(ticks: Any, part: slice) -> dict[str, float]:
    """Strokes of the pump, moves of mass and steering."""

    def applied(name: str) -> np.ndarray:
        before = max(part.start - 1, 0)
        column = np.asarray(getattr(ticks.applied, name), np.float64)
        return np.diff(column[before : part.stop])

    def begun(change: np.ndarray) -> float:
        sense = np.where(np.abs(change) > 1e-9, np.sign(change), 0.0)
        before = np.concatenate([[0.0], sense[:-1]])
        return float(np.sum((sense != 0.0) & (sense != before)))

    pump, angle = applied("buoyancy_mass"), applied("mass_angle")
    return {
        "pushed_kg": float(np.sum(np.maximum(-pump, 0.0))),
        "mass_position_moves": begun(applied("mass_position")),
        "mass_angle_moves": begun(angle),
        "mass_angle_travel_rad": float(np.sum(np.abs(angle))),
    }


def _spent(ticks: Any, ends: slice) -> float:
    if ticks.energy is None:
        return math.nan
    columns = [np.asarray(x, np.float64)[ends] for x in vars(ticks.energy).values()]
    total = np.sum(columns, axis=0)
    return float(total[-1] - total[0])


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if values.size else math.nan


def _deviation(values: np.ndarray) -> float:
    return float(np.std(values)) if values.size else math.nan


def _slope(time: np.ndarray, depth: np.ndarray) -> float:
    """Mean depth rate between the first and the last of some ticks [m/s]."""
    if time.size < 2:
        return math.nan
    return float((depth[-1] - depth[0]) / (time[-1] - time[0]))
