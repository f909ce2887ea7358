"""The closed loop: one control tick, and the scan over all of them.

In each tick: measure, refer, decide (with the disturbance estimate so far), actuate,
integrate the glider with the command held, observe. Nothing here knows a batch: `vmap`
over scenario, controller or sea.
"""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxglider._types import Scalar, Series
from jaxglider.controllers.base import AbstractController
from jaxglider.integrate import RK4, runge_kutta_step
from jaxglider.metrics import Metrics, Sums, add_tick, empty_sums, finish
from jaxglider.observer import AbstractObserver
from jaxglider.performance import Bound
from jaxglider.scenario import Scenario
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    each,
    zeros,
)
from jaxglider.trajectory import TickRecord, Trajectory
from jaxglider.vehicle.actuators import follow_all


class Carry(eqx.Module):
    """What one tick hands to the next."""

    state: GliderState
    held: Command[Scalar]
    reference: Any
    controller: Any
    observer: Any
    sums: Sums
    finished: jax.Array
    reached: jax.Array


class TickInput(eqx.Module):
    """What is known of a tick before the rollout starts; built for all ticks at once.

    Attributes:
        time: start of the tick [s].
        force_start: τ_d at the start of the tick.
        force_end: τ_d at its end.
        planned: the reference's plan.
        bounds: performance functions, or None where the clock is not known beforehand.
    """

    time: jax.Array
    force_start: BodyAxes[jax.Array]
    force_end: BodyAxes[jax.Array]
    planned: Any
    bounds: Channels[Bound] | None


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

    def inputs(self, sea: BodyAxes[Series]) -> TickInput:
        """The scan's inputs: everything that depends on time alone."""
        times = self.scenario.clock.times()[:-1]
        reference = self.scenario.reference
        planned = reference.plan(times)
        bounds = (
            jax.vmap(self.controller.bounds)(planned.clock)
            if reference.scheduled
            else None
        )
        start = each(lambda path: path[:-1], sea)
        return TickInput(
            times, start, each(lambda path: path[1:], sea), planned, bounds
        )

    def tick(self, carry: Carry, given: TickInput) -> tuple[Carry, TickRecord]:
        """One control tick."""
        scenario, controller = self.scenario, self.controller
        dt, state = scenario.clock.dt, carry.state
        measurement = Measurement(
            state, state.attitude(), carry.held, self.observer.estimate(carry.observer)
        )
        reference, reference_state = scenario.reference.step(
            carry.reference, given.planned, measurement, dt
        )
        bounds = given.bounds
        if bounds is None:
            bounds = controller.bounds(reference.clock)
        wanted, controller_state, record = controller.step(
            carry.controller, measurement, reference, bounds, dt
        )
        limits = controller.limits(bounds)
        applied = follow_all(scenario.actuators, carry.held, wanted, dt)
        following = _integrate(scenario, state, applied, given)
        observer_state = self.observer.step(
            carry.observer, measurement, applied, following, dt
        )
        sums = add_tick(
            carry.sums, state, record.error, bounds, limits, wanted, applied, carry.held
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
            after = _hold_when_finished(carry, after)
        return after, TickRecord(
            given.time,
            ~reference.finished,
            state,
            reference.position,
            record.error,
            limits,
            record.surface,
            wanted,
            applied,
            measurement.disturbance,
            self._lumped(measurement, applied, following, given),
            given.force_start,
            reference.target,
            reference.clock,
        )

    def _lumped(
        self,
        measurement: Measurement,
        applied: Command[Scalar],
        following: GliderState,
        given: TickInput,
    ) -> BodyAxes[Scalar]:
        model = getattr(self.controller, "model", None)
        if model is None:
            return given.force_start
        force = model.force(measurement.state, measurement.attitude, applied)
        change = following.velocity() - measurement.state.velocity()
        dt = self.scenario.clock.dt
        return each(
            lambda m, c, f: m * c / dt - f, model.parameters.inertia(), change, force
        )


def _integrate(
    scenario: Scenario, state: GliderState, applied: Command[Scalar], given: TickInput
) -> GliderState:
    """The glider one tick later, the command held, τ_d linear within the tick."""
    substeps = scenario.clock.substeps
    slope = given.force_end - given.force_start

    def substep(s: GliderState, number: Scalar) -> tuple[GliderState, None]:
        def derivative(at: GliderState, node: Scalar) -> GliderState:
            share = (number + node) / substeps
            force = each(lambda f, k: f + share * k, given.force_start, slope)
            return scenario.plant.derivative(at, applied, force)

        step = scenario.clock.dt / substeps
        return runge_kutta_step(RK4, derivative, s, step), None

    if substeps == 1:
        return substep(state, jnp.zeros_like(scenario.clock.dt))[0]
    numbers = jnp.arange(substeps, dtype=scenario.clock.dt.dtype)
    return lax.scan(substep, state, numbers)[0]


def _reached(target: jax.Array, finished: jax.Array) -> jax.Array:
    return (target + jnp.where(finished, 1, 0)).astype(jnp.int32)


def _hold_when_finished(before: Carry, after: Carry) -> Carry:
    """After the last waypoint everything stays as it is."""
    held = jax.tree.map(
        lambda old, new: jnp.where(after.finished, old, new), before, after
    )
    return eqx.tree_at(
        lambda c: (c.finished, c.reached), held, (after.finished, after.reached)
    )


def simulate(loop: ClosedLoop, sea: BodyAxes[Float[Array, " n"]]) -> Trajectory:
    """Roll a closed loop out and keep every tick.

    Args:
        loop: scenario, controller and observer.
        sea: the realised disturbance, `loop.scenario.sea(key)`.
    """

    def tick(carry: Carry, given: TickInput) -> tuple[Carry, TickRecord]:
        return loop.tick(carry, given)

    last, ticks = lax.scan(tick, loop.init(), loop.inputs(sea))
    return Trajectory(ticks, _finish(loop, last))


def evaluate(loop: ClosedLoop, sea: BodyAxes[Float[Array, " n"]]) -> Metrics:
    """Roll a closed loop out and keep its metrics only.

    Memory does not grow with the horizon, but for what the scan's inputs take. Each
    tick is checkpointed: a gradient recomputes it instead of storing its inside.

    Args:
        loop: scenario, controller and observer.
        sea: the realised disturbance, `loop.scenario.sea(key)`.
    """

    @partial(jax.checkpoint, prevent_cse=False)
    def tick(carry: Carry, given: TickInput) -> tuple[Carry, None]:
        return loop.tick(carry, given)[0], None

    last, _ = lax.scan(tick, loop.init(), loop.inputs(sea))
    return _finish(loop, last)


def _finish(loop: ClosedLoop, last: Carry) -> Metrics:
    return finish(last.sums, last.state, last.reached, loop.scenario.clock.dt)
