"""Measures of a whole flight that operators look at, made of its running sums."""

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import square_root
from jaxglider.signals import Command, GliderState
from jaxglider.simulation.flight_sums import FlightSums
from jaxglider.vehicle.energy import Consumers


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
