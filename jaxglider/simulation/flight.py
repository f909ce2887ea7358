"""Measures of a flight that operators look at: as a whole, and dive by dive.

The whole is made of running sums. A half is a dive or a climb with the inflection that
begins it; they are told on the host, from a trajectory. The pitch has settled at the
start of the first 60 s of which 80 % are within 3° of what is wanted.
"""

import itertools
import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import square_root
from jaxglider.guidance.phases import APOGEE, CLIMB, DIVE, INFLECTION, SURFACE
from jaxglider.signals import Command, GliderState
from jaxglider.simulation.flight_sums import HEADING_BAND, STEADY, STILL, FlightSums
from jaxglider.vehicle.energy import Consumers

WINDOW, SHARE, SETTLED = 60.0, 0.8, math.radians(3.0)
"""Length of the window [s], share of it, and error [rad] that tell a settled pitch."""

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
    "made_good_m": "m",
    "energy_J": "J",
    **{f"{name}_energy_J": "J" for name in Consumers.__dataclass_fields__},
    "pushed_kg": "kg",
    "mass_position_moves": "1",
    "mass_position_travel_m": "m",
    "mass_angle_moves": "1",
    "mass_angle_travel_rad": "rad",
}
"""Unit of each measure of a half."""


class FlightMetrics(eqx.Module):
    """Measures of a flight; NaN where there was nothing to take a mean of.

    Attributes:
        energy: energy by who took it [J]; zeros without an energy model.
        total_energy: sum of it [J].
        made_good: distance from start to end, straight and level [m].
        through_water: distance through the water, level [m].
        energy_per_made_good: energy over the first of them [J/m].
        energy_per_through_water: energy over the second [J/m].
        dives: number of dives completed.
        climbs: number of climbs completed.
        surfacings: number of times the glider has come to the surface.
        dive_time: mean duration of a dive, from one inflection to the next [s].
        climb_time: mean duration of a climb [s].
        surface_time: time at the surface altogether [s].
        overshoot: mean depth beyond the trigger of the inflection at the bottom [m].
        pitch_error: root mean square of the pitch error, from 60 s after inflections
            on [rad].
        depth_rate: mean |Z'| then [m/s].
        heading_error: root mean square of the heading error in dives and climbs [rad].
        on_heading: share of the time in dives and climbs within 10° of the heading.
        pushed: ballast pushed out by the pump altogether [kg].
        strokes: number of times the pump has begun to push.
        moves: number of moves of each actuator.
        travel: travel of each actuator [kg, m, rad].
    """

    energy: Consumers
    total_energy: Scalar
    made_good: Scalar
    through_water: Scalar
    energy_per_made_good: Scalar
    energy_per_through_water: Scalar
    dives: Scalar
    climbs: Scalar
    surfacings: Scalar
    dive_time: Scalar
    climb_time: Scalar
    surface_time: Scalar
    overshoot: Scalar
    pitch_error: Scalar
    depth_rate: Scalar
    heading_error: Scalar
    on_heading: Scalar
    pushed: Scalar
    strokes: Scalar
    moves: Command[Scalar]
    travel: Command[Scalar]


def close_flight(
    sums: FlightSums, start: GliderState, end: GliderState
) -> FlightMetrics:
    """Measures of a whole flight.

    Args:
        sums: sums over all ticks.
        start: state at the start.
        end: state at the end.
    """
    total = sums.energy.total()
    north, east = end.north - start.north, end.east - start.east
    made_good = square_root(north**2 + east**2)
    return FlightMetrics(
        energy=sums.energy,
        total_energy=total,
        made_good=made_good,
        through_water=sums.way,
        energy_per_made_good=_mean(total, made_good),
        energy_per_through_water=_mean(total, sums.way),
        dives=sums.dives,
        climbs=sums.climbs,
        surfacings=sums.surfacings,
        dive_time=_mean(sums.dive_time, sums.dives),
        climb_time=_mean(sums.climb_time, sums.climbs),
        surface_time=sums.surface_time,
        overshoot=_mean(sums.overshoot, sums.climbs),
        pitch_error=_root(sums.pitch_squared, sums.steady_time),
        depth_rate=_mean(sums.depth_rate, sums.steady_time),
        heading_error=_root(sums.heading_squared, sums.course_time),
        on_heading=_mean(sums.on_heading, sums.course_time),
        pushed=sums.pushed,
        strokes=sums.strokes,
        moves=sums.moves,
        travel=sums.travel,
    )


def _mean(total: Scalar, count: Scalar) -> Scalar:
    """Total over count; NaN where nothing was counted, with a slope of zero there."""
    none = count <= 0.0
    return jnp.where(none, jnp.nan, total / jnp.where(none, 1.0, count))


def _root(total: Scalar, count: Scalar) -> Scalar:
    none = count <= 0.0
    mean = jnp.where(none, 0.0, total) / jnp.where(none, 1.0, count)
    return jnp.where(none, jnp.nan, square_root(mean))


def halves(run: Any) -> list[dict[str, Any]]:
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
        kind = _kind(int(phase[start]))
        if kind is not None:
            rows.append(
                {"half": kind, "start_s": float(ticks.time[start])}
                | _measures(ticks, kind, slice(start, end), count)
            )
    return rows


def _starts(phase: np.ndarray) -> list[int]:
    """First ticks of the halves and of the stays at the surface."""
    past = np.concatenate([[-1], phase[:-1]])
    turned = np.isin(phase, (APOGEE, INFLECTION, SURFACE)) & (phase != past)
    # A record that leaves ticks out may have missed the turn itself.
    missed = ((past == DIVE) & (phase == CLIMB)) | ((past == CLIMB) & (phase == DIVE))
    return [int(n) for n in np.flatnonzero(turned | missed)]


def _kind(phase: int) -> str | None:
    kinds = {APOGEE: "climb", CLIMB: "climb", INFLECTION: "dive", DIVE: "dive"}
    return kinds.get(int(phase))


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
        "pitch_rad": _average(pitch[steady]),
        "pitch_deviation_rad": _deviation(pitch[steady]),
        "heading_error_rad": math.sqrt(_average(error**2)) if error.size else math.nan,
        "on_heading": _average(np.abs(error) <= HEADING_BAND),
        "depth_rate_m_s": _slope(time[steady], depth[steady]),
        "made_good_m": _made_good(ticks.state, ends),
        **_spent(ticks, ends),
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
        sense = np.where(np.abs(change) > STILL, np.sign(change), 0.0)
        before = np.concatenate([[0.0], sense[:-1]])
        return float(np.sum((sense != 0.0) & (sense != before)))

    pump, angle = applied("buoyancy_mass"), applied("mass_angle")
    position = applied("mass_position")
    return {
        "pushed_kg": float(np.sum(np.maximum(-pump, 0.0))),
        "mass_position_moves": begun(position),
        "mass_position_travel_m": float(np.sum(np.abs(position))),
        "mass_angle_moves": begun(angle),
        "mass_angle_travel_rad": float(np.sum(np.abs(angle))),
    }


def _spent(ticks: Any, ends: slice) -> dict[str, float]:
    """Energy of a half: altogether and by who took it; NaN where it is not counted."""
    used = dict.fromkeys(Consumers.__dataclass_fields__, math.nan)
    for name in used if ticks.energy is not None else ():
        column = np.asarray(getattr(ticks.energy, name), np.float64)[ends]
        used[name] = float(column[-1] - column[0])
    by_consumer = {f"{name}_energy_J": value for name, value in used.items()}
    return {"energy_J": sum(used.values())} | by_consumer


def _made_good(state: GliderState, ends: slice) -> float:
    """Distance from the start of a half to its end, straight and level [m]."""
    north, east = (
        np.asarray(x, np.float64)[ends][[0, -1]] for x in (state.north, state.east)
    )
    return math.hypot(north[1] - north[0], east[1] - east[0])


def _average(values: np.ndarray) -> float:
    return float(np.mean(values)) if values.size else math.nan


def _deviation(values: np.ndarray) -> float:
    return float(np.std(values)) if values.size else math.nan


def _slope(time: np.ndarray, depth: np.ndarray) -> float:
    """Mean depth rate between the first and the last of some ticks [m/s]."""
    if time.size < 2:
        return math.nan
    return float((depth[-1] - depth[0]) / (time[-1] - time[0]))
