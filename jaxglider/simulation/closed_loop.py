"""The closed loop: one control tick.

In each tick: measure, refer, decide (with the disturbance estimate so far), judge,
move (the actuators, and the glider with the command held), observe, add up. Nothing
here knows a batch: `vmap` over scenario, controller or sea.

Controller, reference and observer see the measured state, or, of a glider with
instruments, the estimated one; metrics and records hold the true one. Velocities are
known through the water: nothing under water tells those over ground.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.control.controller import AbstractController
from jaxglider.control.observer import AbstractObserver
from jaxglider.core.containers import Scalar, Series
from jaxglider.guidance.obedience import informed, obeyed
from jaxglider.navigation.estimator import AbstractEstimator
from jaxglider.navigation.navigator import Navigator, begun, recorded
from jaxglider.signals import (
    BodyAxes,
    Command,
    GliderState,
    Measurement,
    zeros,
)
from jaxglider.simulation.flight_sums import add_to_flight, empty_flight
from jaxglider.simulation.metrics import add_tick, empty_sums
from jaxglider.simulation.motion import lumped_disturbance, move, navigated
from jaxglider.simulation.scenario import Scenario, SensorErrors
from jaxglider.simulation.tick import (
    Carry,
    Decision,
    Judgement,
    TickInput,
    TickPlan,
    TickRecord,
    hold_when_finished,
    judged,
    reached,
)
from jaxglider.vehicle.sensors import measured, with_errors


class ClosedLoop(eqx.Module):
    """A scenario with a controller and an observer.

    Attributes:
        scenario: vehicle, sea and reference.
        controller: control law with its gains.
        observer: disturbance observer.
        estimator: estimator of the state; of use where the scenario has instruments,
            and needed there.
    """

    scenario: Scenario
    controller: AbstractController
    observer: AbstractObserver
    estimator: AbstractEstimator | None = None

    @property
    def navigator(self) -> Navigator | None:
        """Sensors, estimator and reckoning; None without instruments.

        Raises:
            ValueError: there are instruments, and no estimator.
        """
        return self.scenario.navigator(self.estimator)

    def init(self) -> Carry:
        """Carry before the first tick: no command held, no disturbance estimated.

        Roll and pitch start without full turns: metrics count what is turned from then
        on. Laws do not care, see `tracking_error`.
        """
        scenario = self.scenario
        state = scenario.initial_state.unturned()
        guidance = scenario.reference.init(state)
        seen, _ = scenario.through_water(state, jnp.zeros_like(scenario.clock.dt))
        return Carry(
            state=state,
            held=zeros(Command, state.surge),
            reference=guidance,
            controller=self.controller.init(),
            observer=self.observer.init(seen),
            sums=empty_sums(state.surge),
            finished=jnp.asarray(False),
            reached=jnp.asarray(0, jnp.int32),
            status=scenario.reference.status(guidance),
            flight=empty_flight(state.surge) if scenario.measures_flight else None,
            known=begun(self.navigator, seen, scenario.altitude(state)),
        )

    def inputs(
        self, sea: BodyAxes[Series], noise: SensorErrors | None = None
    ) -> TickInput:
        """Inputs of all ticks, on one leading axis.

        Args:
            sea: τ_d at the n + 1 ends of the n ticks [N, N m], body frame.
            noise: errors of the sensors there [unit of the state], or None.
        """
        start, end = (
            jax.tree.map(lambda path, part=part: path[part], (sea, noise))
            for part in (slice(None, -1), slice(1, None))
        )
        plan = self.plan(self.scenario.clock.times()[:-1], *end)
        return TickInput(plan, *start)

    def plan(
        self,
        times: Series,
        force_end: BodyAxes[Series],
        noise_end: SensorErrors | None,
    ) -> TickPlan:
        """The part of some ticks' inputs that depends on time alone.

        Args:
            times: starts of the ticks [s].
            force_end: τ_d at their ends [N, N m], body frame.
            noise_end: errors of the sensors there [unit of the state], or None.
        """
        scenario = self.scenario
        planned = scenario.reference.plan(times)
        bounds = judging = None
        if scenario.reference.scheduled:
            bounds = jax.vmap(self.controller.bounds)(planned.clock)
            if scenario.specification is not None:
                judging = jax.vmap(scenario.specification.bounds)(planned.clock)
        return TickPlan(
            time=times,
            force_end=force_end,
            planned=planned,
            bounds=bounds,
            judging=judging,
            noise_end=noise_end,
        )

    def tick(self, carry: Carry, inputs: TickInput) -> tuple[Carry, TickRecord]:
        """One control tick.

        Args:
            carry: state of the loop at the start of the tick.
            inputs: disturbance, sensor errors and plan of the tick.

        Returns:
            The state of the loop at its end, and the record of the tick.
        """
        truth, measurement = self._measure(carry, inputs)
        decision = self._decide(carry, inputs, measurement)
        reference, wanted = decision.reference, decision.wanted
        judgement = judged(self.scenario, self.controller, inputs, truth, decision)
        applied, following = moved = move(
            self.scenario, carry.state, carry.held, wanted, inputs
        )
        known = navigated(
            self.navigator, self.scenario, carry, reference, moved, inputs
        )
        sums = add_tick(
            carry.sums,
            state=carry.state,
            error=judgement.error,
            bounds=judgement.bounds,
            limits=judgement.limits,
            wanted=wanted,
            applied=applied,
            held=carry.held,
        )
        after = Carry(
            state=following,
            held=applied,
            reference=decision.reference_state,
            controller=decision.controller_state,
            observer=self._observe(carry, inputs, measurement, moved, known),
            sums=sums,
            finished=reference.finished,
            reached=reached(reference.target, reference.finished),
            status=None if reference.orders is None else reference.orders.status,
            flight=add_to_flight(
                carry.flight,
                scenario=self.scenario,
                time=inputs.plan.time,
                state=carry.state,
                reference=reference,
                error=judgement.error,
                moves=(carry.held, applied),
            ),
            known=known,
        )
        if self.scenario.reference.can_finish:
            after = hold_when_finished(carry, after)
        return after, self._record(carry, inputs, truth, decision, judgement, moved)

    def _record(
        self,
        carry: Carry,
        inputs: TickInput,
        truth: Measurement,
        decision: Decision,
        judgement: Judgement,
        moved: tuple[Command[Scalar], GliderState],
    ) -> TickRecord:
        """The record of a tick, whose end is where the glider has moved to."""
        reference, (applied, following) = decision.reference, moved
        dt = self.scenario.clock.dt
        following, _ = self.scenario.through_water(following, inputs.plan.time + dt)
        return TickRecord(
            time=inputs.plan.time,
            active=~reference.finished,
            state=carry.state,
            reference=reference.position,
            error=judgement.error,
            limits=judgement.limits,
            law_limits=self.controller.limits(decision.bounds),
            surface=decision.record.surface,
            wanted=decision.wanted,
            applied=applied,
            estimate=truth.disturbance,
            lumped=lumped_disturbance(
                self.controller.model,
                truth,
                applied,
                following,
                inputs.force_start,
                dt,
            ),
            disturbance=inputs.force_start,
            target=reference.target,
            clock=reference.clock,
            phase=None if reference.orders is None else reference.orders.phase,
            energy=carry.spent,
            onboard=recorded(self.navigator, carry.known),
        )

    @jax.named_scope("measurement")
    def _measure(
        self, carry: Carry, inputs: TickInput
    ) -> tuple[Measurement, Measurement]:
        """The measurement of perfect sensors, and that of the scenario's."""
        state, current = self.scenario.through_water(carry.state, inputs.plan.time)
        truth = Measurement(
            state=state,
            attitude=state.attitude(),
            applied=carry.held,
            disturbance=self.observer.estimate(carry.observer),
            altitude=self.scenario.altitude(carry.state),
            charge=self.scenario.charge(carry.spent),
            current=current,
        )
        if self.navigator is not None:
            return truth, self.navigator.measurement(carry.known, truth)
        return truth, measured(truth, inputs.noise_start)

    def _decide(
        self, carry: Carry, inputs: TickInput, measurement: Measurement
    ) -> Decision:
        """The reference of the tick, and the command of the controller."""
        dt, plan = self.scenario.clock.dt, inputs.plan
        with jax.named_scope("guidance"):
            reference, reference_state = self.scenario.reference.step(
                carry.reference, plan.planned, measurement, dt
            )
        with jax.named_scope("controller"):
            bounds = plan.bounds
            if bounds is None:
                bounds = self.controller.bounds(reference.clock)
            wanted, controller_state, record = self.controller.step(
                carry.controller,
                informed(measurement, reference),
                reference,
                bounds,
                dt,
            )
            wanted = obeyed(wanted, reference, carry.held)
        return Decision(
            reference=reference,
            reference_state=reference_state,
            wanted=wanted,
            controller_state=controller_state,
            record=record,
            bounds=bounds,
        )

    @jax.named_scope("observer")
    def _observe(
        self,
        carry: Carry,
        inputs: TickInput,
        measurement: Measurement,
        moved: tuple[Command[Scalar], GliderState],
        known: Any,
    ) -> Any:
        """The next state of the observer."""
        (applied, following), dt = moved, self.scenario.clock.dt
        if self.navigator is not None:
            observed = self.navigator.estimate(known)
        else:
            known_state, _ = self.scenario.through_water(
                following, inputs.plan.time + dt
            )
            observed = with_errors(known_state, inputs.plan.noise_end)
        return self.observer.step(carry.observer, measurement, applied, observed, dt)
