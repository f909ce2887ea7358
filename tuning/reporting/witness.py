"""Assumptions of the theorem as a run shows them: what is seen is measured, not judged.

The law keeps an error in its funnel if it is inside at each restart, the transformation
is the logarithm there, the actuators follow, the disturbance changes no faster than the
observer is made for, and the observer knows it by the time the error has to be settled.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxglider.control.prescribed.funnel import Limits
from jaxglider.core.containers import Scalar
from jaxglider.core.traced_once import traced_once
from jaxglider.signals import BodyAxes, Channels, map_fields, zeros
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from jaxglider.simulation.rollout import closed, with_ticks
from jaxglider.simulation.scenario import SensorErrors
from jaxglider.simulation.tick import Carry, TickInput, TickRecord


class Witness(eqx.Module):
    """Measures of a run that the theorem's assumptions are judged by.

    Attributes:
        at_restart: largest |e| over the edge of the law's own funnel that it nears, in
            the first tick after a restart.
        nearness: largest one of all ticks.
        disturbance: largest |d| [N, N m], d the lumped disturbance of a tick.
        disturbance_rate: largest change of d from tick to tick [N/s, N m/s].
        late_error: largest |d̂ − d| while the errors have to be settled [N, N m].
    """

    at_restart: Channels[Scalar]
    nearness: Channels[Scalar]
    disturbance: BodyAxes[Scalar]
    disturbance_rate: BodyAxes[Scalar]
    late_error: BodyAxes[Scalar]


class _Watch(eqx.Module):
    """A witness so far, and what it has to know of the tick before."""

    seen: Witness
    clock: Scalar
    lumped: BodyAxes[Scalar]
    ticks: Scalar


def assess(
    loop: ClosedLoop,
    sea: BodyAxes[Float[Array, " n"]],
    noise: SensorErrors | None = None,
) -> tuple[Metrics, Witness]:
    """Roll a closed loop out for its metrics, and watch the theorem's assumptions.

    The watch costs a tenth of the rollout; no gradient is meant to go through it.

    Args:
        loop: scenario, controller and observer.
        sea: the realised disturbance, `loop.scenario.sea(key)`.
        noise: the realised errors of the sensors, `loop.scenario.noise(key)`, or None.
    """
    due = _due(loop)
    # A tick does not ask how many there are: one trace for runs of all lengths.
    any_length = with_ticks(loop, 1)

    def step(carry: tuple[Carry, _Watch], inputs: TickInput) -> Any:
        return _watched_tick(any_length, due, carry, inputs), None

    start = loop.init()
    like = start.state.surge
    (last, watch), _ = lax.scan(
        step, (start, _unwatched(like)), loop.inputs(sea, noise)
    )
    return closed(loop.scenario, last), watch.seen


@traced_once
def _watched_tick(
    loop: ClosedLoop, due: Any, carry: tuple[Carry, _Watch], inputs: TickInput
) -> tuple[Carry, _Watch]:
    inner, watch = carry
    after, record = loop.tick(inner, inputs)
    return after, _watched(watch, record, due, loop.scenario.clock.dt)


def _due(loop: ClosedLoop) -> Scalar:
    """The earliest time by which an error has to be settled [s]; 0 where none has."""
    specification = loop.scenario.specification
    times = None if specification is None else specification.required_settling()
    known = [] if times is None else [t for t in vars(times).values() if t is not None]
    if not known:
        return jnp.zeros_like(loop.scenario.clock.dt)
    return jnp.min(jnp.stack(known))


def _unwatched(like: Scalar) -> _Watch:
    """The watch before the first tick, in the precision of a number."""
    channels, axes = zeros(Channels, like), zeros(BodyAxes, like)
    zero = jnp.zeros_like(like)
    seen = Witness(channels, channels, axes, axes, axes)
    return _Watch(seen, zero + jnp.inf, axes, zero)


def _watched(watch: _Watch, record: TickRecord, due: Scalar, dt: Scalar) -> _Watch:
    """The watch after one more tick; ticks after the end of a mission do not count."""
    seen, on = watch.seen, record.active
    restarted = on & (record.clock < watch.clock)
    late = on & (record.clock >= due)
    later = on & (watch.ticks > 0.0)

    def near(e: Scalar, edge: Limits) -> Scalar:
        return jnp.maximum(e / edge.upper, e / edge.lower)

    def largest(flag: Any) -> Any:
        return lambda old, new: jnp.maximum(old, jnp.where(flag, jnp.abs(new), 0.0))

    nearness = map_fields(near, record.error, record.law_limits)
    change = map_fields(lambda a, b: (a - b) / dt, record.lumped, watch.lumped)
    off = map_fields(jnp.subtract, record.estimate, record.lumped)
    return _Watch(
        Witness(
            at_restart=map_fields(largest(restarted), seen.at_restart, nearness),
            nearness=map_fields(largest(on), seen.nearness, nearness),
            disturbance=map_fields(largest(on), seen.disturbance, record.lumped),
            disturbance_rate=map_fields(largest(later), seen.disturbance_rate, change),
            late_error=map_fields(largest(late), seen.late_error, off),
        ),
        record.clock,
        record.lumped,
        watch.ticks + 1.0,
    )
