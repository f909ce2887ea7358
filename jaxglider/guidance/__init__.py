"""References: what the glider is asked to do."""

from jaxglider.guidance.line_of_sight import LineOfSight as LineOfSight
from jaxglider.guidance.reference import AbstractReference as AbstractReference
from jaxglider.guidance.schedule import AttitudeSchedule as AttitudeSchedule
from jaxglider.guidance.schedule import Schedule as Schedule
from jaxglider.guidance.waypoints import WaypointPath as WaypointPath
from jaxglider.guidance.yo import Yo as Yo
