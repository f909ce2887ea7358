"""Restarts of the funnel: how far the reference jumps away from the glider there."""

import math

import numpy as np

from jaxglider.guidance import AttitudeSchedule, WaypointPath
from jaxglider.signals import Channels
from jaxglider.simulation.scenario import Scenario


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
