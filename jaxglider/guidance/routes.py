"""The waypoints in a reference, wherever they stand."""

import dataclasses

from jaxglider.guidance.line_of_sight import LineOfSight
from jaxglider.guidance.reference import AbstractReference
from jaxglider.guidance.waypoints import WaypointPath
from jaxglider.guidance.yo import Yo


def route_of(reference: AbstractReference) -> WaypointPath | None:
    """The path of waypoints that a reference follows, or None."""
    if isinstance(reference, Yo):
        reference = reference.course
    return reference if isinstance(reference, WaypointPath) else None


def guided_by(
    reference: AbstractReference, line_of_sight: LineOfSight
) -> AbstractReference:
    """The reference with other gains of guidance; itself where it has no waypoints.

    Args:
        reference: reference to be changed.
        line_of_sight: gains of guidance.
    """
    if isinstance(reference, Yo):
        course = guided_by(reference.course, line_of_sight)
        return dataclasses.replace(reference, course=course)
    if isinstance(reference, WaypointPath):
        return dataclasses.replace(reference, line_of_sight=line_of_sight)
    return reference
