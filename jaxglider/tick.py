"""What goes into one control tick, and the glider's own part of it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from jaxglider._types import Scalar
from jaxglider.integrate import RK4, runge_kutta_step
from jaxglider.metrics import Sums
from jaxglider.performance import Bound
from jaxglider.scenario import Scenario
from jaxglider.signals import BodyAxes, Channels, Command, GliderState, each
from jaxglider.vehicle.water import derivative_in_water


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


class TickPlan(eqx.Module):
    """What is known of a tick before the rollout starts; built for many at once.

    Attributes:
        time: start of the tick [s].
        force_end: τ_d at its end.
        planned: the reference's plan.
        bounds: the controller's performance functions, or None where the clock is not
            known beforehand.
        judging: those of the scenario's funnel, if it has one; None likewise.
        noise_end: errors of the sensors at its end, or None.
    """

    time: jax.Array
    force_end: BodyAxes[jax.Array]
    planned: Any
    bounds: Channels[Bound] | None
    judging: Channels[Bound] | None
    noise_end: dict[str, jax.Array] | None


class TickInput(TickPlan):
    """The same with what is known at the end of the tick before.

    Attributes:
        force_start: τ_d at the start of the tick.
        noise_start: errors of the sensors there, or None.
    """

    force_start: BodyAxes[jax.Array]
    noise_start: dict[str, jax.Array] | None


def with_start(
    plan: TickPlan,
    force: BodyAxes[jax.Array],
    noise: dict[str, jax.Array] | None,
) -> TickInput:
    """A plan with τ_d and the errors of the sensors at the start of its ticks."""
    return TickInput(**vars(plan), force_start=force, noise_start=noise)


def integrate(
    scenario: Scenario, state: GliderState, applied: Command[Scalar], given: TickInput
) -> GliderState:
    """The glider one tick later, the command held, τ_d linear within the tick."""
    substeps = scenario.clock.substeps
    slope = given.force_end - given.force_start

    def substep(s: GliderState, number: Scalar) -> tuple[GliderState, None]:
        def derivative(at: GliderState, node: Scalar) -> GliderState:
            share = (number + node) / substeps
            force = each(lambda f, k: f + share * k, given.force_start, slope)
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
