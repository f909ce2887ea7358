"""Sense of a closed loop before it is flown: all warnings with their reasons."""

import dataclasses

import jax.numpy as jnp

from jaxglider.signals import Command, zeros
from jaxglider.simulation.checks.causes import LAW_LIMIT, STEP_LIMIT, plant_rates
from jaxglider.simulation.checks.law_rates import fastest_rate
from jaxglider.simulation.checks.ranges import range_warnings
from jaxglider.simulation.checks.stability import glides_of
from jaxglider.simulation.checks.task import task_warnings
from jaxglider.simulation.closed_loop import ClosedLoop

MODEL_FACTOR = 3.0
"""Factor by which a design model may be off before it is hardly meant."""


def sense_warnings(loop: ClosedLoop, *, whole: bool = True) -> list[str]:
    """Warnings on a closed loop that can be flown and is hardly meant as it is.

    Args:
        loop: closed loop with concrete numbers.
        whole: flag, the run is meant to last as long as the task.
    """
    return [
        *range_warnings(loop),
        *task_warnings(loop, whole=whole),
        *model_warnings(loop),
        *tick_warnings(loop),
    ]


def model_warnings(loop: ClosedLoop) -> list[str]:
    """A warning on a design model that is far from the glider.

    Args:
        loop: closed loop with concrete numbers.
    """
    model = loop.controller.model
    if model is None:
        return []
    believed, true = model.parameters, loop.scenario.plant.parameters
    factor = float(believed.surge_mass) / float(true.surge_mass)
    if 1.0 / MODEL_FACTOR <= factor <= MODEL_FACTOR:
        return []
    return [
        f"the law believes the glider to have {factor:.3g} times its mass: see "
        "vehicle.design_factor, 0.8 in the paper and 1 for a glider that is known."
    ]


def tick_warnings(loop: ClosedLoop) -> list[str]:
    """Warnings on a tick that is too long for the glider, or for its law.

    Args:
        loop: closed loop with concrete numbers.
    """
    clock = loop.scenario.clock
    step, found = float(clock.dt) / clock.substeps, []
    start = loop.scenario.initial_state
    speed = max((glide.speed for glide in glides_of(loop)), default=0.4)
    gliding = jnp.maximum(jnp.asarray(start.surge), min(speed, 1.0))
    state = dataclasses.replace(start, surge=gliding)
    rate = max(plant_rates(loop, [(state, zeros(Command, state.surge))]), default=0.0)
    if step * rate > STEP_LIMIT:
        found.append(
            f"the integration step of {step:.3g} s is too long for the glider, whose "
            f"fastest motion takes {1.0 / rate:.3g} s: steps up to "
            f"{STEP_LIMIT / rate:.2g} s are stable. See clock.dt_s and substeps."
        )
    of_law = fastest_rate(loop.controller)
    if of_law is not None and float(clock.dt) * float(of_law) > LAW_LIMIT:
        found.append(
            f"the tick of {float(clock.dt):.3g} s is too long for the law, whose own "
            f"variables move in {1.0 / float(of_law):.2g} s: see clock.dt_s, or lower "
            "the gains."
        )
    return found
