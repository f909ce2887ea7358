"""Warnings about the start of a run."""

import jax
import jax.numpy as jnp

from jaxglider.control import tracking_error
from jaxglider.control.funnel import Limits
from jaxglider.core.containers import Scalar
from jaxglider.signals import CHANNELS, Channels, Measurement
from jaxglider.simulation.closed_loop import ClosedLoop


def start_warnings(loop: ClosedLoop) -> list[str]:
    """Warnings about the start: a course that is over, errors outside the funnel."""
    error, limits, finished = jax.jit(_start)(loop)
    if bool(finished):
        return [
            "nothing is flown: the last waypoint is reached where the glider starts. "
            "Move the waypoint or the start, or make its radius smaller."
        ]
    warnings = []
    for channel in CHANNELS:
        e, edge = getattr(error, channel), getattr(limits, channel)
        if not bool((e > edge.lower) & (e < edge.upper)):
            warnings.append(
                f"the {channel} error starts at {float(e):.4g}, outside its funnel "
                f"({float(edge.lower):.4g}, {float(edge.upper):.4g}): the run goes on, "
                "but the prescribed performance is not guaranteed."
            )
    return warnings


def _start(loop: ClosedLoop) -> tuple[Channels[Scalar], Channels[Limits], jax.Array]:
    """Error and edges of the funnel in the first tick, and whether all is over."""
    scenario = loop.scenario
    state = scenario.initial_state
    planned = scenario.reference.plan(jnp.zeros_like(scenario.clock.dt)[None])
    carry = loop.init()
    measurement = Measurement(
        state=state,
        attitude=state.attitude(),
        applied=carry.held,
        disturbance=loop.observer.estimate(carry.observer),
    )
    first = jax.tree.map(lambda x: x[0], planned)
    reference, _ = scenario.reference.step(
        carry.reference, first, measurement, scenario.clock.dt
    )
    error, _ = tracking_error(measurement, reference)
    limits = loop.controller.limits(loop.controller.bounds(reference.clock))
    return error, limits, reference.finished
