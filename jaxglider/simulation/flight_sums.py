"""Running sums of a flight: energy, distance, yos, pitch, heading and moves.

All is added up tick by tick, so that it costs no memory, and is differentiable where it
is smooth: counts and times of phases are not. `halves` tells the same dive by dive.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Flag, Scalar
from jaxglider.core.numerics import square_root
from jaxglider.core.rotations import body_to_ned
from jaxglider.environment.water import current_at
from jaxglider.guidance.phases import APOGEE, CLIMB, DIVE, INFLECTION, SURFACE
from jaxglider.signals import Channels, Command, GliderState, Reference, map_fields
from jaxglider.simulation.scenario import Scenario
from jaxglider.vehicle.energy import Consumers

STEADY = 60.0
"""Time after an inflection from which pitch and depth rate count as steady [s]."""
HEADING_BAND = math.radians(10.0)
"""Heading error within which a glider is on its heading [rad]."""
STILL = 1e-9
"""Move below which an actuator has not moved [kg, m or rad]."""


class FlightSums(eqx.Module):
    """Running sums of a flight, and what is remembered to make them.

    `moving` are the actuators that moved in the tick before, -1, 0 or 1 each; `open` is
    the time since the present half began; `trigger` and `extreme` are those of the last
    inflection at the bottom.
    """

    energy: Consumers
    way: Scalar
    pushed: Scalar
    strokes: Scalar
    moving: Command[Scalar]
    moves: Command[Scalar]
    travel: Command[Scalar]
    phase: jax.Array
    open: Scalar
    dives: Scalar
    climbs: Scalar
    surfacings: Scalar
    dive_time: Scalar
    climb_time: Scalar
    surface_time: Scalar
    trigger: Scalar
    extreme: Scalar
    overshoot: Scalar
    steady_time: Scalar
    pitch_squared: Scalar
    depth_rate: Scalar
    course_time: Scalar
    heading_squared: Scalar
    on_heading: Scalar


def empty_flight(like: Scalar) -> FlightSums:
    """Sums before the first tick, in the precision of `like`."""
    zero = jnp.zeros_like(like)
    three = Command(zero, zero, zero)
    return FlightSums(
        energy=Consumers(*(zero,) * 6),
        moving=three,
        moves=three,
        travel=three,
        phase=jnp.asarray(SURFACE, jnp.int32),
        **{name: zero for name in _PLAIN},
    )


_PLAIN = tuple(
    name
    for name in FlightSums.__annotations__
    if name not in ("energy", "moving", "moves", "travel", "phase")
)


@jax.named_scope("flight")
def add_to_flight(
    sums: FlightSums | None,
    *,
    scenario: Scenario,
    time: Scalar,
    state: GliderState,
    reference: Reference,
    error: Channels[Scalar],
    moves: tuple[Command[Scalar], Command[Scalar]],
) -> FlightSums | None:
    """Sums with one more tick, where a flight is measured.

    Args:
        sums: sums over the ticks before, or None.
        scenario: scenario that is flown.
        time: start of the tick [s].
        state: true state at the start of the tick.
        reference: reference of the tick.
        error: e [m, rad].
        moves: positions of the actuators at the start and the end of the tick.
    """
    if sums is None:
        return None
    dt, energy = scenario.clock.dt, scenario.energy
    orders = reference.orders
    phase = sums.phase if orders is None else orders.phase
    before, after = moves
    north, east, sinking = body_to_ned(
        state.attitude(), state.surge, state.sway, state.heave
    )
    current = current_at(scenario.water, state.depth, time)
    way = square_root((north - current[0]) ** 2 + (east - current[1]) ** 2)
    change = map_fields(jnp.subtract, after, before)
    moving = map_fields(
        lambda c: jnp.where(jnp.abs(c) > STILL, jnp.sign(c), 0.0), change
    )
    began = map_fields(
        lambda now, was: jnp.where((now != 0.0) & (now != was), 1.0, 0.0),
        moving,
        sums.moving,
    )
    pushing = moving.buoyancy_mass < 0.0
    changed = phase != sums.phase
    at_surface = (phase == SURFACE) & (orders is not None)
    arrived = changed & at_surface
    spent = sums.energy
    if energy is not None:
        stay = at_surface, arrived
        gravity = scenario.plant.parameters.gravity
        used = energy.spent(moves, state.depth, gravity, stay, dt)
        spent = map_fields(jnp.add, spent, used)
    return FlightSums(
        energy=spent,
        way=sums.way + way * dt,
        pushed=sums.pushed + jnp.maximum(-change.buoyancy_mass, 0.0),
        strokes=sums.strokes + jnp.where(pushing, began.buoyancy_mass, 0.0),
        moving=moving,
        moves=map_fields(jnp.add, sums.moves, began),
        travel=map_fields(lambda t, c: t + jnp.abs(c), sums.travel, change),
        phase=jnp.asarray(phase, jnp.int32),
        surfacings=sums.surfacings + jnp.where(arrived, 1.0, 0.0),
        surface_time=sums.surface_time + jnp.where(at_surface, dt, 0.0),
        **_halves(sums, phase, changed, state.depth, dt),
        **_steady(sums, phase, reference.clock, error, sinking, dt),
    )


def _halves(
    sums: FlightSums, phase: jax.Array, changed: Flag, depth: Scalar, dt: Scalar
) -> dict[str, Scalar]:
    """Dives and climbs: their number, their time, and the overshoot between them."""
    dived = changed & (phase == APOGEE)
    climbed = changed & (sums.phase == CLIMB)
    begins = dived | (changed & ((phase == INFLECTION) | (phase == SURFACE)))
    rising = (phase == APOGEE) | (phase == CLIMB)
    extreme = jnp.where(rising, jnp.maximum(sums.extreme, depth), sums.extreme)
    over = jnp.where(climbed, sums.extreme - sums.trigger, 0.0)
    return {
        "open": jnp.where(begins, 0.0, sums.open) + dt,
        "dives": sums.dives + jnp.where(dived, 1.0, 0.0),
        "climbs": sums.climbs + jnp.where(climbed, 1.0, 0.0),
        "dive_time": sums.dive_time + jnp.where(dived, sums.open, 0.0),
        "climb_time": sums.climb_time + jnp.where(climbed, sums.open, 0.0),
        "trigger": jnp.where(dived, depth, sums.trigger),
        "extreme": jnp.where(dived, depth, extreme),
        "overshoot": sums.overshoot + over,
    }


def _steady(
    sums: FlightSums,
    phase: jax.Array,
    clock: Scalar,
    error: Channels[Scalar],
    sinking: Scalar,
    dt: Scalar,
) -> dict[str, Scalar]:
    """Errors of pitch and heading, and the depth rate, where they mean something."""
    gliding = (phase == DIVE) | (phase == CLIMB)
    steady = jnp.where(gliding & (clock > STEADY), dt, 0.0)
    course = jnp.where(gliding, dt, 0.0)
    near = jnp.abs(error.heading) <= HEADING_BAND
    return {
        "steady_time": sums.steady_time + steady,
        "pitch_squared": sums.pitch_squared + steady * error.pitch**2,
        "depth_rate": sums.depth_rate + steady * jnp.abs(sinking),
        "course_time": sums.course_time + course,
        "heading_squared": sums.heading_squared + course * error.heading**2,
        "on_heading": sums.on_heading + jnp.where(near, course, 0.0),
    }
