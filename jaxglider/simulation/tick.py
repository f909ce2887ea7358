"""Data of one control tick: its input, its carry and its record."""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.control.controller import (
    AbstractController,
    ControlRecord,
    tracking_error,
)
from jaxglider.control.prescribed.funnel import Limits
from jaxglider.control.prescribed.performance import Bound
from jaxglider.core.containers import Scalar
from jaxglider.navigation.navigator import OnBoard
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    Reference,
)
from jaxglider.simulation.flight_sums import FlightSums
from jaxglider.simulation.metrics import Sums
from jaxglider.simulation.scenario import Scenario
from jaxglider.vehicle.energy import Consumers


class Carry(eqx.Module):
    """State of the closed loop between two ticks.

    Attributes:
        state: true state of the glider.
        held: command held by the actuators.
        reference: state of the reference.
        controller: state of the controller.
        observer: state of the observer.
        sums: running sums of the metrics.
        finished: flag, the mission is over.
        reached: number of waypoints reached or of segments completed.
        status: number of the end of the mission, an index of `phases.STATUSES`; None
            where the reference knows no such ends.
        flight: running sums of the flight; None where it is not measured.
        known: state of the navigator; None without instruments.
    """

    state: GliderState
    held: Command[Scalar]
    reference: Any
    controller: Any
    observer: Any
    sums: Sums
    finished: jax.Array
    reached: jax.Array
    status: jax.Array | None = None
    flight: FlightSums | None = None
    known: Any = None

    @property
    def spent(self) -> Consumers | None:
        """Energy spent so far, by who took it [J]; None where it is not counted."""
        return None if self.flight is None else self.flight.energy


class TickPlan(eqx.Module):
    """The part of a tick's input known before the rollout; built for many at once.

    Attributes:
        time: start of the tick [s].
        force_end: τ_d at its end [N, N m], body frame.
        planned: plan of the reference.
        bounds: performance functions of the controller, or None where the clock of the
            funnel is not known beforehand.
        judging: P_spec of the scenario's specification; None where it has none or the
            clock is not known beforehand.
        noise_end: errors of the sensors at its end [unit of the state] or samples of
            the instruments, or None.
    """

    time: jax.Array
    force_end: BodyAxes[jax.Array]
    planned: Any
    bounds: Channels[Bound] | None
    judging: Channels[Bound] | None
    noise_end: Any


class TickInput(eqx.Module):
    """Input of one tick: its plan, and values handed on from the end of the last one.

    Attributes:
        plan: the part known before the rollout.
        force_start: τ_d at the start of the tick [N, N m], body frame.
        noise_start: errors of the sensors there [unit of the state] or samples of the
            instruments, or None.
    """

    plan: TickPlan
    force_start: BodyAxes[jax.Array]
    noise_start: Any


class TickRecord(eqx.Module):
    """Record of one tick; a trajectory is this with a leading time axis.

    Attributes:
        time: start of the tick [s].
        active: flag, the mission was still on.
        state: true state at the start of the tick.
        reference: η_d [m, rad].
        error: η − η_d [m, rad], heading wrapped to [−π, π).
        limits: edges of the specified funnel, which errors are judged by [m, rad].
        law_limits: edges of the law's own funnel [m, rad].
        surface: sliding variable of the controller.
        wanted: command of the controller [kg, m, rad].
        applied: command held by the actuators during the tick [kg, m, rad].
        estimate: d̂ at the start of the tick [N, N m], body frame.
        lumped: d, the true value of d̂ [N, N m]: mean over the tick of the force that
            the design model leaves unexplained (the disturbance itself without a
            design model).
        disturbance: τ_d at the start of the tick [N, N m], body frame.
        target: number of the waypoint or segment being followed.
        clock: t*, time since the funnel's restart [s].
        phase: number of the phase of the yo, an index of `phases.PHASES`; None where
            the reference has no phases.
        energy: energy spent before the tick, by who took it [J], or None.
        onboard: knowledge on board at the start of the tick; None without instruments.
    """

    time: Scalar
    active: jax.Array
    state: GliderState
    reference: Channels[Scalar]
    error: Channels[Scalar]
    limits: Channels[Limits]
    law_limits: Channels[Limits]
    surface: Channels[Scalar]
    wanted: Command[Scalar]
    applied: Command[Scalar]
    estimate: BodyAxes[Scalar]
    lumped: BodyAxes[Scalar]
    disturbance: BodyAxes[Scalar]
    target: jax.Array
    clock: Scalar
    phase: jax.Array | None = None
    energy: Consumers | None = None
    onboard: OnBoard | None = None


class Decision(NamedTuple):
    """Reference and command of a tick, with the next states of their makers."""

    reference: Reference
    reference_state: Any
    wanted: Command[Scalar]
    controller_state: Any
    record: ControlRecord
    bounds: Channels[Bound]


class Judgement(NamedTuple):
    """True error, performance functions and edges of the funnel it is judged by."""

    error: Channels[Scalar]
    bounds: Channels[Bound]
    limits: Channels[Limits]


def hold_when_finished(before: Carry, after: Carry) -> Carry:
    """The carry of the next tick, which stays as it is after the last waypoint.

    Args:
        before: carry at the start of the tick.
        after: carry at its end, had the mission gone on.
    """
    held = jax.tree.map(
        lambda old, new: jnp.where(after.finished, old, new), before, after
    )
    return dataclasses.replace(
        held, finished=after.finished, reached=after.reached, status=after.status
    )


@jax.named_scope("judgement")
def judged(
    scenario: Scenario,
    controller: AbstractController,
    inputs: TickInput,
    truth: Measurement,
    decision: Decision,
) -> Judgement:
    """The true error, and the specification that it is judged by.

    Args:
        scenario: scenario that is flown.
        controller: law, whose own funnel judges where there is no specification.
        inputs: input of the tick.
        truth: measurement of perfect sensors.
        decision: reference and command of the tick.
    """
    reference, error = decision.reference, decision.record.error
    if inputs.noise_start is not None:
        error, _ = tracking_error(truth, reference)
    specification, bounds = scenario.specification, decision.bounds
    if specification is None:
        return Judgement(error, bounds, controller.limits(bounds))
    judging = inputs.plan.judging
    if judging is None:
        judging = specification.bounds(reference.clock)
    return Judgement(error, judging, specification.limits(judging))


def reached(target: jax.Array, finished: jax.Array) -> jax.Array:
    """Number of waypoints reached, or of segments completed.

    Args:
        target: number of the one being followed.
        finished: flag, the mission is over.
    """
    return (target + jnp.where(finished, 1, 0)).astype(jnp.int32)
