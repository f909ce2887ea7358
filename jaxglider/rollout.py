"""The closed loop: one control tick, and the scan over all of them.

In each tick: measure, refer, decide (with the disturbance estimate so far), actuate,
integrate the glider with the command held, observe. Nothing here knows a batch: `vmap`
over scenario, controller or sea.

Controller, reference and observer see the measured state; metrics and records hold the
true one.
"""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxglider._types import Scalar, Series
from jaxglider.controllers.base import AbstractController, Limits, tracking_error
from jaxglider.metrics import Metrics, add_tick, empty_sums, finish
from jaxglider.numerics import faded
from jaxglider.observer import AbstractObserver
from jaxglider.performance import Bound
from jaxglider.scenario import Scenario
from jaxglider.sensors import measured, with_errors
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    each,
    zeros,
)
from jaxglider.tick import Carry, TickInput, hold_when_finished, integrate
from jaxglider.trajectory import TickRecord, Trajectory
from jaxglider.vehicle.actuators import follow_all

Kept = TypeVar("Kept")


class ClosedLoop(eqx.Module):
    """A scenario with who steers it.

    Attributes:
        scenario: vehicle, sea and task.
        controller: the law and its gains.
        observer: the disturbance observer.
    """

    scenario: Scenario
    controller: AbstractController
    observer: AbstractObserver

    def init(self) -> Carry:
        """Everything before the first tick."""
        scenario = self.scenario
        state = scenario.initial_state
        return Carry(
            state,
            zeros(Command, state.surge),
            scenario.reference.init(state),
            self.controller.init(),
            self.observer.init(state),
            empty_sums(state.surge),
            jnp.asarray(False),
            jnp.asarray(0, jnp.int32),
        )

    def inputs(
        self, sea: BodyAxes[Series], noise: dict[str, Series] | None = None
    ) -> TickInput:
        """The scan's inputs: everything that depends on time alone."""
        scenario = self.scenario
        times = scenario.clock.times()[:-1]
        planned = scenario.reference.plan(times)
        bounds = judging = None
        if scenario.reference.scheduled:
            bounds = jax.vmap(self.controller.bounds)(planned.clock)
            if scenario.funnel is not None:
                judging = jax.vmap(scenario.funnel.bounds)(planned.clock)
        start, end = (
            jax.tree.map(lambda path, part=part: path[part], (sea, noise))
            for part in (slice(None, -1), slice(1, None))
        )
        return TickInput(
            times, start[0], end[0], planned, bounds, judging, start[1], end[1]
        )

    def tick(self, carry: Carry, given: TickInput) -> tuple[Carry, TickRecord]:
        """One control tick."""
        scenario, controller = self.scenario, self.controller
        dt, state = scenario.clock.dt, carry.state
        estimate = self.observer.estimate(carry.observer)
        truth = Measurement(state, state.attitude(), carry.held, estimate)
        measurement = measured(truth, given.noise_start)
        reference, reference_state = scenario.reference.step(
            carry.reference, given.planned, measurement, dt
        )
        bounds = given.bounds
        if bounds is None:
            bounds = controller.bounds(reference.clock)
        wanted, controller_state, record = controller.step(
            carry.controller, measurement, reference, bounds, dt
        )
        error = record.error
        if given.noise_start is not None:
            error, _ = tracking_error(truth, reference)
        judging, limits = self._judged(bounds, given, reference.clock)
        applied = follow_all(scenario.actuators, carry.held, wanted, dt, given.time)
        following = integrate(scenario, state, applied, given)
        observed = with_errors(following, given.noise_end)
        observer_state = self.observer.step(
            carry.observer, measurement, applied, observed, dt
        )
        sums = add_tick(
            carry.sums, state, error, judging, limits, wanted, applied, carry.held
        )
        after = Carry(
            following,
            applied,
            reference_state,
            controller_state,
            observer_state,
            sums,
            reference.finished,
            _reached(reference.target, reference.finished),
        )
        if scenario.reference.can_finish:
            after = hold_when_finished(carry, after)
        return after, TickRecord(
            given.time,
            ~reference.finished,
            state,
            reference.position,
            error,
            limits,
            record.surface,
            wanted,
            applied,
            estimate,
            self._lumped(truth, applied, following, given),
            given.force_start,
            reference.target,
            reference.clock,
        )

    def _judged(
        self, bounds: Channels[Bound], given: TickInput, clock: Scalar
    ) -> tuple[Channels[Bound], Channels[Limits]]:
        """Performance functions and edges of the funnel that errors are judged by."""
        funnel = self.scenario.funnel
        if funnel is None:
            return bounds, self.controller.limits(bounds)
        judging = funnel.bounds(clock) if given.judging is None else given.judging
        return judging, funnel.limits(judging)

    def _lumped(
        self,
        truth: Measurement,
        applied: Command[Scalar],
        following: GliderState,
        given: TickInput,
    ) -> BodyAxes[Scalar]:
        model = getattr(self.controller, "model", None)
        if model is None:
            return given.force_start
        force = model.force(truth.state, truth.attitude, applied)
        change = following.velocity() - truth.state.velocity()
        dt = self.scenario.clock.dt
        return each(
            lambda m, c, f: m * c / dt - f, model.parameters.inertia(), change, force
        )


def _reached(target: jax.Array, finished: jax.Array) -> jax.Array:
    return (target + jnp.where(finished, 1, 0)).astype(jnp.int32)


def roll(
    loop: ClosedLoop,
    sea: BodyAxes[Series],
    noise: dict[str, Series] | None,
    tick: Callable[[Carry, TickInput], tuple[Carry, Kept]],
) -> tuple[Metrics, Kept]:
    """The scan over all ticks; `simulate` and `evaluate` differ in what they keep.

    The end of a tick is the start of the next: it is handed on, not read twice.

    Args:
        loop: scenario, controller and observer.
        sea: the realised disturbance.
        noise: the realised errors of the sensors, or None.
        tick: `loop.tick`, or a function around it that chooses what is kept.

    Returns:
        The metrics, and what each tick has kept, stacked.
    """
    given = loop.inputs(sea, noise)
    starts = given.force_start, given.noise_start
    first = jax.tree.map(lambda x: x[0], starts)
    ends = eqx.tree_at(
        lambda g: (g.force_start, g.noise_start),
        given,
        (None, None),
        is_leaf=lambda x: x is None,
    )

    def step(carry: Any, end: TickInput) -> Any:
        inner, (force, errors) = carry
        whole = dataclasses.replace(end, force_start=force, noise_start=errors)
        after, kept = tick(inner, whole)
        return (after, (end.force_end, end.noise_end)), kept

    (last, _), kept = lax.scan(step, (loop.init(), first), ends)
    metrics = finish(last.sums, last.state, last.reached, loop.scenario.clock.dt)
    return metrics, kept


def simulate(
    loop: ClosedLoop,
    sea: BodyAxes[Float[Array, " n"]],
    noise: dict[str, Float[Array, " n"]] | None = None,
) -> Trajectory:
    """Roll a closed loop out and keep every tick.

    Args:
        loop: scenario, controller and observer.
        sea: the realised disturbance, `loop.scenario.sea(key)`.
        noise: the realised errors of the sensors, `loop.scenario.noise(key)`, or None.
    """
    metrics, ticks = roll(loop, sea, noise, loop.tick)
    return Trajectory(ticks, metrics)


def evaluate(
    loop: ClosedLoop,
    sea: BodyAxes[Float[Array, " n"]],
    noise: dict[str, Float[Array, " n"]] | None = None,
    *,
    gradient_memory: Scalar | float | None = None,
) -> Metrics:
    """Roll a closed loop out and keep its metrics only.

    Memory does not grow with the horizon, but for what the scan's inputs take. Each
    tick is checkpointed: a gradient recomputes it instead of storing its inside.

    Where a loop oscillates, the exact derivative of a long run grows by orders of
    magnitude with its horizon and foretells nothing. With a gradient memory τ the
    influence of what was t seconds ago is weighed by e^(−t/τ): a biased derivative, a
    far better guide, and the exact one for τ = ∞. Values do not change.

    Args:
        loop: scenario, controller and observer.
        sea: the realised disturbance, `loop.scenario.sea(key)`.
        noise: the realised errors of the sensors, `loop.scenario.noise(key)`, or None.
        gradient_memory: τ [s]; None for the exact derivative.
    """

    @partial(jax.checkpoint, prevent_cse=False)
    def tick(carry: Carry, given: TickInput) -> tuple[Carry, None]:
        if gradient_memory is not None:
            carry = _forgetting(
                carry, jnp.exp(-loop.scenario.clock.dt / gradient_memory)
            )
        return loop.tick(carry, given)[0], None

    return roll(loop, sea, noise, tick)[0]


def _forgetting(carry: Carry, share: Scalar) -> Carry:
    """All that acts on later ticks, faded; the sums of the metrics only add up."""
    return dataclasses.replace(
        jax.tree.map(
            lambda x: faded(x, share) if jnp.issubdtype(x.dtype, jnp.floating) else x,
            carry,
        ),
        sums=carry.sums,
    )
