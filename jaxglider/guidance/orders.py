"""Orders of a yo mission in each phase: what its plan sets whatever the law wants."""

from typing import Any

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.guidance import phases as names
from jaxglider.guidance.phases import Turning
from jaxglider.guidance.progress import YoState
from jaxglider.guidance.settings import YoSettings
from jaxglider.signals import Orders


def orders_of(plan: YoSettings, state: YoState) -> Orders:
    """Ballast of the phase, whether the mass waits, and the steering of a spiral.

    Args:
        plan: settings of the mission.
        state: progress, in the phase that the tick is flown in.
    """
    phase = state.phase
    apogee, inflection = plan.apogee, plan.inflection
    ballast = by_phase(
        phase,
        plan.surface.buoyancy_mass,
        state.dive_ballast,
        _while_turning(apogee, state.ordered, state.climb_ballast),
        state.climb_ballast,
        _while_turning(inflection, state.ordered, state.dive_ballast),
    )
    waits = (phase == names.APOGEE) & (apogee.order == "pump")
    waits = waits | ((phase == names.INFLECTION) & (inflection.order == "pump"))
    steering = None
    if plan.spiral is not None:
        climbing = (phase == names.CLIMB) | (phase == names.APOGEE)
        sign = jnp.where(climbing & plan.spiral_flips, -1.0, 1.0)
        steering = jnp.where(phase == names.SURFACE, 0.0, sign) * plan.spiral
    down, up = state.dive_ballast, state.climb_ballast
    settled = by_phase(
        phase,
        plan.surface.buoyancy_mass,
        down,
        up if apogee.buoyancy_mass is None else apogee.buoyancy_mass,
        up,
        down if inflection.buoyancy_mass is None else inflection.buoyancy_mass,
    )
    limit = _steering_limit(plan, state)
    return Orders(ballast, settled, waits, phase, state.status, steering, limit)


def _steering_limit(plan: YoSettings, state: YoState) -> Scalar | None:
    """Largest angle of the mass or the fin for now [rad]; None if never limited.

    A half counts from its inflection on: while it has to wait, nobody steers.
    """
    dive, climb = plan.dive, plan.climb
    limits = (None, dive, plan.apogee, climb, plan.inflection)
    given: list[Any] = [getattr(of, "steering_limit", None) for of in limits]
    waits = [half.steering_wait for half in (dive, climb)]
    if all(value is None for value in (*given, *waits)):
        return None
    free = jnp.full_like(state.depth, jnp.inf)
    limit = by_phase(state.phase, *(free if x is None else x for x in given))
    down, up = (0.0 if wait is None else wait for wait in waits)
    never = jnp.zeros_like(state.depth)
    wait = by_phase(state.phase, never, never + down, never + up, never + up, down)
    return jnp.where(state.half < wait, never, limit)


def _while_turning(turning: Turning, before: Scalar, after: Scalar) -> Scalar:
    """Ballast while what moves first at an inflection moves."""
    if turning.order == "mass":
        return before
    return after if turning.buoyancy_mass is None else turning.buoyancy_mass


def by_phase(phase: jax.Array, *values: Scalar) -> Scalar:
    """The value of the phase, of one for each.

    Args:
        phase: number of the phase.
        values: value in each phase, in their order.
    """
    chosen = values[0]
    for number, value in enumerate(values[1:], 1):
        chosen = jnp.where(phase == number, value, chosen)
    return chosen
