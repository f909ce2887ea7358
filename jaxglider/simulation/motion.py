"""Motion of the glider over one control tick, and what is seen and known of it."""

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxglider.core.containers import Scalar, Series
from jaxglider.core.runge_kutta import RK4, runge_kutta_step
from jaxglider.environment.surface import surface_force
from jaxglider.environment.water import current_at, derivative_in_water
from jaxglider.guidance.phases import SURFACE
from jaxglider.navigation.estimator import Moves
from jaxglider.navigation.navigator import Navigator, NavigatorState, Surroundings
from jaxglider.signals import (
    BodyAxes,
    Command,
    GliderState,
    Measurement,
    Reference,
    map_fields,
)
from jaxglider.simulation.scenario import Scenario
from jaxglider.simulation.tick import Carry, TickInput
from jaxglider.vehicle.actuators import follow_all
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.sensors import with_errors


def move(
    scenario: Scenario,
    state: GliderState,
    held: Command[Scalar],
    wanted: Command[Scalar],
    inputs: TickInput,
) -> tuple[Command[Scalar], GliderState]:
    """Actuators and glider one tick later.

    Args:
        scenario: plant, actuators, water and clock.
        state: state at the start of the tick.
        held: positions of the actuators then [kg, m, rad].
        wanted: command held over the tick [kg, m, rad].
        inputs: start of the tick and τ_d at both its ends.

    Returns:
        Positions of the actuators at the end of the tick, and the state then.
    """
    if scenario.clock.moving:
        return integrate_moving(scenario, state, held, wanted, inputs)
    dt, time = scenario.clock.dt, inputs.plan.time
    applied = follow_all(scenario.actuators, held, wanted, dt, time, state.depth)
    return applied, integrate(scenario, state, applied, inputs)


@jax.named_scope("integration")
def integrate(
    scenario: Scenario, state: GliderState, applied: Command[Scalar], inputs: TickInput
) -> GliderState:
    """The glider one tick later, the command held, τ_d linear within the tick.

    Args:
        scenario: plant, water and clock.
        state: state at the start of the tick.
        applied: command held by the actuators [kg, m, rad].
        inputs: start of the tick and τ_d at both its ends.
    """

    def substep(s: GliderState, number: Scalar) -> tuple[GliderState, None]:
        return _substep(scenario, s, applied, inputs, number), None

    if scenario.clock.substeps == 1:
        return substep(state, jnp.zeros_like(scenario.clock.dt))[0]
    return lax.scan(substep, state, _numbers(scenario))[0]


@jax.named_scope("integration")
def integrate_moving(
    scenario: Scenario,
    state: GliderState,
    held: Command[Scalar],
    wanted: Command[Scalar],
    inputs: TickInput,
) -> tuple[Command[Scalar], GliderState]:
    """Actuators and glider one tick later, both moved from step to step.

    Args:
        scenario: plant, actuators, water and clock.
        state: state at the start of the tick.
        held: positions of the actuators then [kg, m, rad].
        wanted: command held over the tick [kg, m, rad].
        inputs: start of the tick and τ_d at both its ends.
    """
    step = scenario.clock.dt / scenario.clock.substeps

    def substep(carry: Any, number: Scalar) -> tuple[Any, None]:
        position, s = carry
        moved = follow_all(
            scenario.actuators,
            position,
            wanted,
            step,
            inputs.plan.time + number * step,
            s.depth,
        )
        return (moved, _substep(scenario, s, moved, inputs, number)), None

    end: tuple[Command[Scalar], GliderState]
    end, _ = lax.scan(substep, (held, state), _numbers(scenario))
    return end


def _numbers(scenario: Scenario) -> Series:
    """Numbers of the integration steps of a tick."""
    clock = scenario.clock
    return jnp.arange(clock.substeps, dtype=clock.dt.dtype)


def _substep(
    scenario: Scenario,
    state: GliderState,
    applied: Command[Scalar],
    inputs: TickInput,
    number: Scalar,
) -> GliderState:
    """The glider one integration step later."""
    time, start, end = inputs.plan.time, inputs.force_start, inputs.plan.force_end
    substeps = scenario.clock.substeps
    slope = end - start

    def derivative(at: GliderState, node: Scalar) -> GliderState:
        share = (number + node) / substeps
        force = map_fields(lambda f, k: f + share * k, start, slope)
        force = force + surface_force(scenario.plant, at)
        if scenario.water is None:
            return scenario.plant.derivative(at, applied, force)
        return derivative_in_water(
            scenario.plant,
            scenario.water,
            at,
            applied,
            force,
            time + share * scenario.clock.dt,
        )

    return runge_kutta_step(RK4, derivative, state, scenario.clock.dt / substeps)


def navigated(
    navigator: Navigator | None,
    scenario: Scenario,
    carry: Carry,
    reference: Reference,
    moved: tuple[Command[Scalar], GliderState],
    inputs: TickInput,
) -> NavigatorState | None:
    """Knowledge on board at the end of a tick; None without instruments.

    Args:
        navigator: sensors, estimator and reckoning.
        scenario: scenario that is flown.
        carry: state of the loop at the start of the tick.
        reference: reference of the tick.
        moved: positions of the actuators and true state at the end of the tick.
        inputs: input of the tick.
    """
    if navigator is None:
        return None
    applied, following = moved
    samples: Any
    samples, dt = inputs.plan.noise_end, scenario.clock.dt
    current = current_at(scenario.water, following.depth, inputs.plan.time + dt)
    around = Surroundings(following, scenario.altitude(following), current)
    measured = with_errors(following, samples.errors)
    under_way, orders = jnp.ones_like(dt), reference.orders
    if orders is not None:
        under_way = jnp.where(orders.phase == SURFACE, 0.0, under_way)
    return navigator.step(
        carry.known,
        around,
        measured,
        samples.instruments,
        Moves(carry.held, applied),
        reference.clock,
        under_way,
        dt,
    )


@jax.named_scope("lumped_disturbance")
def lumped_disturbance(
    model: DesignModel | None,
    truth: Measurement,
    applied: Command[Scalar],
    following: GliderState,
    disturbance: BodyAxes[Scalar],
    dt: Scalar,
) -> BodyAxes[Scalar]:
    """d = M Δν/Δt − F [N, N m], body frame: the true value of d̂ over one tick.

    Args:
        model: design model of the controller, which gives M and F.
        truth: true state and attitude at the start of the tick.
        applied: command held by the actuators [kg, m, rad].
        following: true state at the end of the tick.
        disturbance: τ_d at the start of the tick, the result without a design model.
        dt: tick [s].
    """
    if model is None:
        return disturbance
    force = model.force(truth.state, truth.attitude, applied)
    change = following.velocity() - truth.state.velocity()
    return map_fields(
        lambda m, c, f: m * c / dt - f, model.parameters.inertia(), change, force
    )
