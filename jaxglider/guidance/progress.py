"""Progress through a yo: the memory from tick to tick, and the rules that change it.

The overshoot of an inflection is how much farther the depth goes after it was ordered.
Its running mean, m ← m + a (o − m), is how much earlier the next one is ordered.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Flag, Scalar
from jaxglider.guidance import phases as names
from jaxglider.guidance.phases import HalfYo, StopRules, Turning
from jaxglider.signals import Measurement

APPROACH = 0.02
"""Share of the stroke from dive to climb within which the pump has arrived."""
PUMP_STILL = 0.001
"""Share of that stroke per second below which the pump has stopped [1/s]."""
MASS_STILL = 1e-4
"""Speed below which the moving mass has stopped [m/s]."""


class YoState(eqx.Module):
    """Progress of the glider through its yos.

    Attributes:
        phase: number of the phase.
        entered: time in the phase [s].
        half: time since the present dive, climb or stay began, inflection and all [s].
        yos: number of yos completed.
        surfaced_yos: number of them when the glider last surfaced.
        surfaced_at: time when it was last at the surface [s].
        surfaced_target: number of the waypoint made for then.
        depth: last depth believed [m].
        silent: time since it was measured [s].
        rate: averaged depth rate [m/s].
        begun: depth at which the present half began [m].
        trigger: depth at which the last inflection was ordered [m].
        extreme: depth farthest beyond it since [m].
        early_bottom: running mean of the overshoot at the bottom [m].
        early_top: running mean of the overshoot at the top [m].
        turned: flag, the last inflection was under water, not at the surface.
        best: depth farthest in the direction of the present half [m].
        hovering: time for which the glider has hovered [s].
        stalled: time since it last got farther [s].
        dive_ballast: ballast of the dives [kg].
        climb_ballast: ballast of the climbs [kg].
        ordered: ballast ordered in the previous tick [kg].
        pump: ballast held one tick ago [kg].
        mass: position of the moving mass one tick ago [m].
        status: number of the end of the mission.
        course: state of the course.
    """

    phase: jax.Array
    entered: Scalar
    half: Scalar
    yos: jax.Array
    surfaced_yos: jax.Array
    surfaced_at: Scalar
    surfaced_target: jax.Array
    depth: Scalar
    silent: Scalar
    rate: Scalar
    begun: Scalar
    trigger: Scalar
    extreme: Scalar
    early_bottom: Scalar
    early_top: Scalar
    turned: jax.Array
    best: Scalar
    hovering: Scalar
    stalled: Scalar
    dive_ballast: Scalar
    climb_ballast: Scalar
    ordered: Scalar
    pump: Scalar
    mass: Scalar
    status: jax.Array
    course: Any


def listened(
    state: YoState, measurement: Measurement, stop: StopRules, dt: Scalar
) -> YoState:
    """Depth and depth rate, unless the depth has jumped.

    Args:
        state: progress so far.
        measurement: measurement of this tick.
        stop: rules that tell good depths from bad.
        dt: tick [s].
    """
    depth, gap = measurement.state.depth, state.silent + dt
    believed = jnp.abs(depth - state.depth) <= stop.depth_rate_limit * gap
    raw = (depth - state.depth) / gap
    rate = state.rate - jnp.expm1(-gap / stop.rate_memory) * (raw - state.rate)
    return dataclasses.replace(
        state,
        depth=jnp.where(believed, depth, state.depth),
        silent=jnp.where(believed, 0.0, gap),
        rate=jnp.where(believed, rate, state.rate),
    )


def counted(state: YoState, stop: StopRules, dt: Scalar) -> YoState:
    """The farthest depth of the half, and the times of hovering and of stall.

    Args:
        state: progress so far.
        stop: rules that tell when a glider hovers.
        dt: tick [s].
    """
    rising = (state.phase == names.CLIMB) | (state.phase == names.APOGEE)
    moving = (state.phase == names.CLIMB) | (state.phase == names.DIVE)
    onward = jnp.where(rising, -1.0, 1.0)
    farther = onward * (state.depth - state.best) > 0.0
    still = moving & (jnp.abs(state.rate) < stop.hover_rate)
    return dataclasses.replace(
        state,
        best=jnp.where(farther, state.depth, state.best),
        stalled=jnp.where(moving & ~farther, state.stalled + dt, 0.0),
        hovering=jnp.where(still, state.hovering + dt, 0.0),
        extreme=jnp.where(
            rising,
            jnp.maximum(state.extreme, state.depth),
            jnp.minimum(state.extreme, state.depth),
        ),
    )


def arrived(
    state: YoState, measurement: Measurement, turning: Turning, dt: Scalar
) -> Flag:
    """Whether what moves first has arrived, or has stopped on its way.

    Args:
        state: progress so far.
        measurement: measurement, with the positions of the actuators.
        turning: settings of the inflection.
        dt: tick [s].
    """
    applied = measurement.applied
    # What moves has been told in the tick before, and may have moved for one.
    begun = state.entered >= 2.0 * dt
    if turning.order == "mass":
        stopped = jnp.abs(applied.mass_position - state.mass) <= MASS_STILL * dt
        done = begun & stopped
    else:
        stroke = jnp.abs(state.dive_ballast) + jnp.abs(state.climb_ballast)
        moved = jnp.abs(applied.buoyancy_mass - state.pump)
        left = jnp.abs(applied.buoyancy_mass - state.ordered)
        done = (state.entered >= dt) & (left <= APPROACH * stroke)
        done = done | (begun & (moved <= PUMP_STILL * stroke * dt))
    return done | (state.entered >= turning.longest)


def turned_over(
    state: YoState,
    following: jax.Array,
    halves: tuple[HalfYo, HalfYo],
    early_share: Scalar,
) -> YoState:
    """The state after a change of phase.

    At the end of a half its overshoot, its depth rate and the yo are booked.

    Args:
        state: progress so far.
        following: number of the phase to go on in.
        halves: settings of dive and climb.
        early_share: weight of the newest overshoot in its running mean.
    """
    dive, climb = halves
    changed = following != state.phase
    down = changed & (following == names.INFLECTION)
    up = changed & (following == names.APOGEE)
    surfaced = changed & (following == names.SURFACE)
    climbed = changed & (state.phase == names.CLIMB)
    ends = down | up | surfaced

    def averaged(mean: Scalar, newest: Scalar) -> Scalar:
        return mean + early_share * (newest - mean)

    lowest = averaged(state.early_bottom, state.extreme - state.trigger)
    highest = averaged(state.early_top, state.trigger - state.extreme)
    rate = jnp.abs(state.depth - state.begun) / jnp.maximum(state.half, 1e-3)
    zero = jnp.zeros_like(state.depth)
    return dataclasses.replace(
        state,
        phase=jnp.asarray(following, jnp.int32),
        entered=jnp.where(changed, zero, state.entered),
        half=jnp.where(ends, zero, state.half),
        begun=jnp.where(ends, state.depth, state.begun),
        trigger=jnp.where(ends, state.depth, state.trigger),
        extreme=jnp.where(ends, state.depth, state.extreme),
        early_bottom=jnp.where(climbed, lowest, state.early_bottom),
        early_top=jnp.where(up & state.turned, highest, state.early_top),
        turned=jnp.where(ends, climbed & ~surfaced, state.turned),
        best=jnp.where(changed, state.depth, state.best),
        hovering=jnp.where(changed, zero, state.hovering),
        stalled=jnp.where(changed, zero, state.stalled),
        yos=state.yos + jnp.where(climbed, 1, 0),
        dive_ballast=_adjusted(state.dive_ballast, dive, rate, up),
        climb_ballast=_adjusted(state.climb_ballast, climb, rate, climbed),
    )


def _adjusted(ballast: Scalar, half: HalfYo, rate: Scalar, ends: Flag) -> Scalar:
    """The ballast of the next such half, heavier where this one was too slow."""
    if half.depth_rate is None:
        return ballast
    if half.adjust_every is not None:
        return jnp.where(ends, half.buoyancy_mass, ballast)
    more = half.ballast_gain * (half.depth_rate - rate)
    size = jnp.clip(jnp.abs(ballast) + more, 0.0, half.largest)
    return jnp.where(ends, jnp.sign(ballast) * size, ballast)


def regulated(state: YoState, halves: tuple[HalfYo, HalfYo], dt: Scalar) -> YoState:
    """The ballast of the half that is on, more of it where the glider is too slow.

    Args:
        state: progress so far.
        halves: settings of dive and climb.
        dt: tick [s].
    """

    def ballast(now: Scalar, half: HalfYo, phase: int) -> Scalar:
        if half.depth_rate is None or half.adjust_every is None:
            return now
        looks = jnp.floor(state.entered / half.adjust_every)
        looked = jnp.floor((state.entered - dt) / half.adjust_every)
        missing = half.depth_rate - jnp.abs(state.rate)
        slow = (state.phase == phase) & (looks > looked) & (state.entered > 0.0)
        slow = slow & (missing > half.depth_rate_band)
        size = jnp.minimum(jnp.abs(now) + half.ballast_gain * missing, half.largest)
        return jnp.where(slow, jnp.sign(now) * size, now)

    dive, climb = halves
    return dataclasses.replace(
        state,
        dive_ballast=ballast(state.dive_ballast, dive, names.DIVE),
        climb_ballast=ballast(state.climb_ballast, climb, names.CLIMB),
    )
