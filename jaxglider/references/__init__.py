"""References: what the glider is asked to do."""

from jaxglider.references.attitude import AttitudeSchedule as AttitudeSchedule
from jaxglider.references.base import AbstractReference as AbstractReference
from jaxglider.references.base import Schedule as Schedule
from jaxglider.references.waypoints import LineOfSight as LineOfSight
from jaxglider.references.waypoints import WaypointPath as WaypointPath
