"""Remarks on a mission before it is flown or tuned, and on a law that loses it."""

from jaxglider.files.mission import Mission
from jaxglider.simulation.checks.sense import sense_warnings
from jaxglider.simulation.checks.stability import (
    glides_of,
    loop_modes,
    lost,
    statement,
    surface_warning,
)
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.reporting.console import note


def note_sense(mission: Mission, loop: ClosedLoop) -> None:
    """Say what in a mission is hardly meant as it is.

    How long it lasts is left to `validate`: a short run is often meant.

    Args:
        mission: mission from its file.
        loop: closed loop of it as it is flown.
    """
    for warning in (*mission.remarks, *sense_warnings(loop, whole=False)):
        note(f"warning: {warning}")


def note_stability(loop: ClosedLoop) -> None:
    """Say whether a loop is stable in the parts of its task.

    Args:
        loop: closed loop; nothing is said where its task has no straight glides.
    """
    modes = loop_modes(loop, glides_of(loop))
    if modes:
        note(statement(modes))
    at_surface = surface_warning(loop)
    if at_surface:
        note(at_surface)


def note_lost(loop: ClosedLoop, who: str = "") -> None:
    """Say in which parts of its task a loop is not stable; nothing if it is.

    Args:
        loop: closed loop.
        who: name and case of it, before each sentence.
    """
    for text in lost(loop):
        note(f"{who}{text}")
