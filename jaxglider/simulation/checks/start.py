"""Start and restarts: warnings before a run, and jumps where its funnels restart."""

import dataclasses
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.guidance import AttitudeSchedule, WaypointPath
from jaxglider.signals import CHANNELS, BodyAxes, Channels, zeros
from jaxglider.simulation.checks.task import schedule_of, wanted_depths
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import with_ticks
from jaxglider.simulation.scenario import Scenario


def start_warnings(loop: ClosedLoop) -> list[str]:
    """Warnings: a course already over, errors beyond the funnel, depths in the air.

    Raises:
        FloatingPointError: something is not finite at the start already.
    """
    first = jax.tree.map(np.asarray, jax.jit(_start)(loop))
    error, limits, finished, numbers = first
    refuse_nonsense(numbers)
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


def refuse_nonsense(numbers: dict[str, Any]) -> None:
    """Refuse a start that has numbers which are not finite.

    Args:
        numbers: containers of numbers of the first tick, by what they are.

    Raises:
        FloatingPointError: names the first such number.
    """
    for what, container in numbers.items():
        for name, value in vars(container).items():
            if not np.all(np.isfinite(value)):
                raise FloatingPointError(
                    f"the run cannot start: {what} {name.replace('_', ' ')} is "
                    f"{float(value):g} at 0 s. {_NONSENSE[what]}"
                )


_NONSENSE = {
    "the error of": "Look at initial_state and at the reference.",
    "the law's command of": "Look at its gains; in a law of your own, at divisions by "
    "zero and roots of zero.",
    "the rate of": "Look at initial_state and at vehicle.parameters: a speed that is "
    "far too large, or a mass or an inertia that is far too small.",
}


def above_the_surface(scenario: Scenario) -> list[str]:
    """Start and wanted depths that are above the surface, where no glider flies."""
    found = []
    start = float(scenario.initial_state.depth)
    if start < 0.0:
        found.append(
            f"the glider starts {-start:.4g} m above the surface; "
            "initial_state.depth_m is positive down."
        )
    schedule = schedule_of(scenario.reference)
    if schedule is None:
        return found
    times, depths = wanted_depths(schedule, scenario)
    # Rounding of a yo that comes back to the surface is none.
    if depths.min() < -1e-3:
        found.append(
            f"the wanted depth is above the surface, up to {-depths.min():.4g} m at "
            f"{times[depths.argmin()]:.4g} s: see depth_rate_m_s (positive down) and "
            "initial_depth_m of reference.schedule. No glider can follow it there."
        )
    return found


def _start(loop: ClosedLoop) -> tuple[Any, ...]:
    """Error and edges of the funnel in the first tick, and whether all is over.

    And the numbers that must be finite for there to be a second tick. No force disturbs
    it, and the state is known.
    """
    scenario = dataclasses.replace(loop.scenario, sensors=None, instruments=None)
    loop = dataclasses.replace(loop, scenario=scenario, estimator=None)
    begin, brief = loop.init(), with_ticks(loop, 1)
    calm = zeros(BodyAxes, jnp.zeros_like(scenario.clock.dt, shape=2))
    inputs = jax.tree.map(lambda x: x[0], brief.inputs(calm))
    after, first = loop.tick(begin, inputs)
    numbers = {
        "the error of": first.error,
        "the law's command of": first.wanted,
        "the rate of": scenario.plant.derivative(
            begin.state, begin.held, inputs.force_start
        ),
    }
    return first.error, first.law_limits, after.finished, numbers


def restart_jumps(scenario: Scenario) -> Channels[float]:
    """Largest jump of each reference at a restart within the run [m, rad].

    The first is from the initial state, exactly known; at the others it is the step
    from one segment to the next, of a glider that was on its reference. So an error
    that is left before a restart adds to it, or takes from it. The angle of attack,
    which the pitch reference follows, does not jump. On a course the step of the
    heading is the turn between two legs; what the line of sight adds is not known
    beforehand. Of other references nothing is known: 0.

    Args:
        scenario: task and initial state, with concrete numbers.
    """
    reference, start = scenario.reference, scenario.initial_state
    horizon = scenario.clock.ticks * float(scenario.clock.dt)
    if isinstance(reference, AttitudeSchedule):
        s = reference.schedule
        flown = np.asarray(s.start) < horizon
        aims = np.asarray(s.gliding_angle)[flown], np.asarray(s.heading)[flown]
        first = float(s.initial_depth), float(aims[0][0]), float(aims[1][0])
        steps = [_wrapped(np.diff(aim)) for aim in aims]
    elif isinstance(reference, WaypointPath):
        azimuths = _azimuths(reference)
        s = reference.vertical
        first = float(s.initial_depth), float(s.gliding_angle[0]), float(azimuths[0])
        # The pitch jumps with the vertical schedule, where no funnel restarts.
        steps = [np.zeros(1), _wrapped(np.diff(azimuths))]
    else:
        return Channels(0.0, 0.0, 0.0)
    here = float(start.depth), float(start.pitch), float(start.heading)
    depth = abs(here[0] - first[0])
    pitch, heading = (
        float(np.abs(_wrapped(np.append(step, now - aim))).max())
        for step, now, aim in zip(steps, here[1:], first[1:], strict=True)
    )
    return Channels(depth, pitch, heading)


def _azimuths(path: WaypointPath) -> np.ndarray:
    """Azimuth of each leg [rad]."""
    north = np.concatenate([[float(path.start_north)], np.asarray(path.north)])
    east = np.concatenate([[float(path.start_east)], np.asarray(path.east)])
    return np.arctan2(np.diff(east), np.diff(north))


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """The angles in [−π, π)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
