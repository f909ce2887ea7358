"""Warnings about a run before it starts."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.control import tracking_error
from jaxglider.control.funnel import Limits
from jaxglider.core.containers import Scalar
from jaxglider.guidance import (
    AbstractReference,
    AttitudeSchedule,
    Schedule,
    WaypointPath,
)
from jaxglider.signals import CHANNELS, Channels, Measurement
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.scenario import Scenario


def start_warnings(loop: ClosedLoop) -> list[str]:
    """Warnings: a course already over, errors beyond the funnel, depths in the air."""
    error, limits, finished = jax.jit(_start)(loop)
    if bool(finished):
        return [
            "nothing is flown: the last waypoint is reached where the glider starts. "
            "Move the waypoint or the start, or make its radius smaller."
        ]
    warnings = above_the_surface(loop.scenario)
    for channel in CHANNELS:
        e, edge = getattr(error, channel), getattr(limits, channel)
        if not bool((e > edge.lower) & (e < edge.upper)):
            warnings.append(
                f"the {channel} error starts at {float(e):.4g}, outside its funnel "
                f"({float(edge.lower):.4g}, {float(edge.upper):.4g}): the run goes on, "
                "but the prescribed performance is not guaranteed."
            )
    return warnings


def above_the_surface(scenario: Scenario) -> list[str]:
    """Start and wanted depths that are above the surface, where no glider flies."""
    found = []
    start = float(scenario.initial_state.depth)
    if start < 0.0:
        found.append(
            f"the glider starts {-start:.4g} m above the surface; "
            "initial_state.depth_m is positive down."
        )
    schedule = _schedule(scenario.reference)
    if schedule is None:
        return found
    # Wanted depth is linear within a segment: the ends tell.
    end = scenario.clock.ticks * float(scenario.clock.dt)
    begun = np.asarray(schedule.start, np.float64)
    times = np.append(begun[begun < end], end)
    lengths, rates = np.diff(times), np.asarray(schedule.depth_rate, np.float64)
    sunk = np.cumsum(lengths * rates[: len(lengths)])
    depths = float(schedule.initial_depth) + np.append(0.0, sunk)
    # Rounding of a yo that comes back to the surface is none.
    if depths.min() < -1e-3:
        found.append(
            f"the wanted depth is above the surface, up to {-depths.min():.4g} m at "
            f"{times[depths.argmin()]:.4g} s: see depth_rate_m_s (positive down) and "
            "initial_depth_m of reference.schedule. No glider can follow it there."
        )
    return found


def _schedule(reference: AbstractReference) -> Schedule | None:
    """The schedule that gives the depth, if one does."""
    if isinstance(reference, AttitudeSchedule):
        return reference.schedule
    return reference.vertical if isinstance(reference, WaypointPath) else None


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
