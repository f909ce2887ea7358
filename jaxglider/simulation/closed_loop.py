"""The closed loop: one control tick.

In each tick: measure, refer, decide (with the disturbance estimate so far), actuate,
integrate the glider with the command held, observe. Nothing here knows a batch: `vmap`
over scenario, controller or sea.

Controller, reference and observer see the measured state; metrics and records hold the
true one.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from jaxglider.control.controller import AbstractController, tracking_error
from jaxglider.control.funnel import Limits
from jaxglider.control.observer import AbstractObserver
from jaxglider.control.performance import Bound
from jaxglider.core.containers import Scalar, Series
from jaxglider.core.runge_kutta import RK4, runge_kutta_step
from jaxglider.environment.water import derivative_in_water
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    map_fields,
    zeros,
)
from jaxglider.simulation.metrics import add_tick, empty_sums
from jaxglider.simulation.scenario import Scenario
from jaxglider.simulation.tick import Carry, TickInput, TickPlan, TickRecord, with_start
from jaxglider.vehicle.actuators import follow_all
from jaxglider.vehicle.sensors import measured, with_errors


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
        """Everything before the first tick.

        Roll and pitch start without full turns: metrics count what is turned from then
        on. Laws do not care, see `tracking_error`.
        """
        scenario = self.scenario
        state = scenario.initial_state.unturned()
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
        start, end = (
            jax.tree.map(lambda path, part=part: path[part], (sea, noise))
            for part in (slice(None, -1), slice(1, None))
        )
        plan = self.plan(self.scenario.clock.times()[:-1], *end)
        return with_start(plan, *start)

    def plan(
        self,
        times: Series,
        force_end: BodyAxes[Series],
        noise_end: dict[str, Series] | None,
    ) -> TickPlan:
        """What is known of some ticks beforehand.

        Args:
            times: when they start [s].
            force_end: τ_d at their ends.
            noise_end: errors of the sensors there, or None.
        """
        scenario = self.scenario
        planned = scenario.reference.plan(times)
        bounds = judging = None
        if scenario.reference.scheduled:
            bounds = jax.vmap(self.controller.bounds)(planned.clock)
            if scenario.funnel is not None:
                judging = jax.vmap(scenario.funnel.bounds)(planned.clock)
        return TickPlan(times, force_end, planned, bounds, judging, noise_end)

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
        model = self.controller.model
        if model is None:
            return given.force_start
        force = model.force(truth.state, truth.attitude, applied)
        change = following.velocity() - truth.state.velocity()
        dt = self.scenario.clock.dt
        return map_fields(
            lambda m, c, f: m * c / dt - f, model.parameters.inertia(), change, force
        )


def _reached(target: jax.Array, finished: jax.Array) -> jax.Array:
    return (target + jnp.where(finished, 1, 0)).astype(jnp.int32)


def integrate(
    scenario: Scenario, state: GliderState, applied: Command[Scalar], given: TickInput
) -> GliderState:
    """The glider one tick later, the command held, τ_d linear within the tick."""
    substeps = scenario.clock.substeps
    slope = given.force_end - given.force_start

    def substep(s: GliderState, number: Scalar) -> tuple[GliderState, None]:
        def derivative(at: GliderState, node: Scalar) -> GliderState:
            share = (number + node) / substeps
            force = map_fields(lambda f, k: f + share * k, given.force_start, slope)
            if scenario.water is None:
                return scenario.plant.derivative(at, applied, force)
            return derivative_in_water(
                scenario.plant,
                scenario.water,
                at,
                applied,
                force,
                given.time + share * scenario.clock.dt,
            )

        step = scenario.clock.dt / substeps
        return runge_kutta_step(RK4, derivative, s, step), None

    if substeps == 1:
        return substep(state, jnp.zeros_like(scenario.clock.dt))[0]
    numbers = jnp.arange(substeps, dtype=scenario.clock.dt.dtype)
    return lax.scan(substep, state, numbers)[0]


def hold_when_finished(before: Carry, after: Carry) -> Carry:
    """After the last waypoint everything stays as it is."""
    held = jax.tree.map(
        lambda old, new: jnp.where(after.finished, old, new), before, after
    )
    return eqx.tree_at(
        lambda c: (c.finished, c.reached), held, (after.finished, after.reached)
    )
