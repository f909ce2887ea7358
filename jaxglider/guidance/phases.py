"""Phases of a yo and the ends of a mission: their names, numbers and settings.

A glider flies dive, inflection at the bottom (apogee), climb, inflection at the top,
again and again, and comes up now and then. Its ballast is set once for each phase.

Source: what operators of gliders set, and what the vendors' manuals call it; hover and
stall are told apart here by what the depth does, see `StopRules`.
"""

import math

import equinox as eqx

from jaxglider.core.containers import (
    Container,
    Scalar,
    as_float,
    check_interval,
    choose,
)

PHASES = ("surface", "dive", "apogee", "climb", "inflection")
"""Names of the phases by their numbers; `inflection` is the one at the top."""
SURFACE, DIVE, APOGEE, CLIMB, INFLECTION = range(len(PHASES))

STATUSES = (
    "under way",
    "completed",
    "unfinished",
    "bottom",
    "hover",
    "stall",
    "battery empty",
)
"""Names of the ends of a mission by their numbers."""
UNDER_WAY, COMPLETED, UNFINISHED, BOTTOM, HOVER, STALL, BATTERY_EMPTY = range(
    len(STATUSES)
)

STATUS_TEXTS = (
    "the mission is still on",
    "the mission was flown to its end",
    "the run ended before the mission did: yos, surfacing or waypoints are missing",
    "the glider met the bottom",
    "the glider hung at one depth longer than it may",
    "the glider got no deeper in a dive, or no higher in a climb, longer than it may",
    "the battery is empty",
)
"""Sentences on the ends of a mission by their numbers."""

ORDERS = ("pump", "mass", "together")
"""Names of what moves first at an inflection."""


class HalfYo(Container):
    """Settings of the way down, or of the way up.

    Attributes:
        angle: wanted pitch [rad], positive nose up; or the angle of the path.
        buoyancy_mass: m_b [kg], positive sinks.
        of_path: flag, `angle` is that of the path, not the pitch.
        depth_rate: wanted modulus of the depth rate [m/s], or None to leave the ballast
            as it is. After each half yo the ballast of the next one is changed by
            `ballast_gain` times what was missing.
        adjust_every: time from one look at the depth rate to the next within a half
            [s], or None to look at its end alone. Each look that misses more than
            `depth_rate_band` adds to the ballast of this half.
        depth_rate_band: missing depth rate that is borne then [m/s].
        ballast_gain: ballast per missing depth rate [kg s/m].
        largest: largest modulus of the ballast [kg] that this may lead to.
        steering_limit: largest angle of the mass or the fin on this half [rad]; None
            for what the actuator can do.
        steering_wait: time from the inflection on in which nobody steers [s].

    Raises:
        ValueError: the angle is not within ±90°, or a number is negative.
    """

    angle: Scalar = eqx.field(converter=as_float)
    buoyancy_mass: Scalar = eqx.field(converter=as_float)
    of_path: bool = eqx.field(static=True, default=False)
    depth_rate: Scalar | None = eqx.field(converter=as_float, default=None)
    adjust_every: Scalar | None = eqx.field(converter=as_float, default=None)
    depth_rate_band: Scalar = eqx.field(converter=as_float, default=0.005)
    ballast_gain: Scalar = eqx.field(converter=as_float, default=2.0)
    largest: Scalar = eqx.field(converter=as_float, default=1.0)
    steering_limit: Scalar | None = eqx.field(converter=as_float, default=None)
    steering_wait: Scalar | None = eqx.field(converter=as_float, default=None)

    def __check_init__(self) -> None:
        half_turn = 0.5 * math.pi
        check_interval("HalfYo", "angle", self.angle, -half_turn, half_turn)
        for name in ("depth_rate", "adjust_every"):
            check_interval("HalfYo", name, getattr(self, name), 0.0)
        for name in (
            "ballast_gain",
            "largest",
            "depth_rate_band",
            "steering_limit",
            "steering_wait",
        ):
            check_interval("HalfYo", name, getattr(self, name), 0.0, closed_low=True)


class Turning(Container):
    """Settings of an inflection.

    Attributes:
        order: name of what moves first: `pump` (the mass is held until the pump has
            stopped), `mass` (the pump waits until the mass has stopped), or `together`.
        longest: time after which the second one moves whatever the first one does [s].
        angle: pitch wanted while the first one moves [rad]; None for that of the next
            half.
        buoyancy_mass: ballast meanwhile [kg]; None for that of the next half.
        steering_limit: largest angle of the mass or the fin meanwhile [rad]; None for
            what the actuator can do.

    Raises:
        ValueError: the order is unknown, the time is not positive, or the limit is
            negative.
    """

    order: str = eqx.field(static=True, default="together")
    longest: Scalar = eqx.field(converter=as_float, default=900.0)
    angle: Scalar | None = eqx.field(converter=as_float, default=None)
    buoyancy_mass: Scalar | None = eqx.field(converter=as_float, default=None)
    steering_limit: Scalar | None = eqx.field(converter=as_float, default=None)

    def __check_init__(self) -> None:
        choose("Turning.order", self.order, ORDERS)
        check_interval("Turning", "longest", self.longest, 0.0)
        check_interval(
            "Turning", "steering_limit", self.steering_limit, 0.0, closed_low=True
        )


class SurfaceStay(Container):
    """Settings of a stay at the surface.

    Attributes:
        depth: depth from which the glider counts as surfaced [m].
        duration: time of a stay, for fixes and calls [s].
        first: time of the stay that the mission begins with [s].
        angle: wanted pitch [rad].
        buoyancy_mass: ballast [kg], negative floats.
        every_yos: yos from one surfacing to the next; None for no such rule.
        every: time from one surfacing to the next [s]; None for no such rule.
        at_waypoints: flag, the glider surfaces whenever it has reached a waypoint.

    Raises:
        ValueError: a number is negative.
    """

    depth: Scalar = eqx.field(converter=as_float, default=2.0)
    duration: Scalar = eqx.field(converter=as_float, default=600.0)
    first: Scalar = eqx.field(converter=as_float, default=0.0)
    angle: Scalar = eqx.field(converter=as_float, default=-0.35)
    buoyancy_mass: Scalar = eqx.field(converter=as_float, default=-0.2)
    every_yos: int | None = eqx.field(static=True, default=None)
    every: Scalar | None = eqx.field(converter=as_float, default=None)
    at_waypoints: bool = eqx.field(static=True, default=False)

    def __check_init__(self) -> None:
        for name in ("depth", "every"):
            check_interval("SurfaceStay", name, getattr(self, name), 0.0)
        for name in ("duration", "first"):
            value = getattr(self, name)
            check_interval("SurfaceStay", name, value, 0.0, closed_low=True)
        check_interval("SurfaceStay", "every_yos", self.every_yos, 1.0, closed_low=True)


class StopRules(Container):
    """Rules that end a mission early, and those that tell good depths from bad.

    A glider hovers while its depth rate is small; it is stalled while it gets no deeper
    in a dive, or no higher in a climb, than it has been in it.

    Attributes:
        hover_rate: depth rate below which the glider hovers [m/s].
        hover_time: time of hovering that ends the mission [s].
        stall_time: time without progress that ends the mission [s].
        depth_rate_limit: largest believable rate of the measured depth [m/s]; a depth
            that changes faster is not believed.
        rate_memory: time over which the depth rate is averaged [s].

    Raises:
        ValueError: a number is not positive.
    """

    hover_rate: Scalar = eqx.field(converter=as_float, default=0.02)
    hover_time: Scalar = eqx.field(converter=as_float, default=180.0)
    stall_time: Scalar = eqx.field(converter=as_float, default=240.0)
    depth_rate_limit: Scalar = eqx.field(converter=as_float, default=0.76)
    rate_memory: Scalar = eqx.field(converter=as_float, default=20.0)

    def __check_init__(self) -> None:
        for name in vars(self):
            check_interval("StopRules", name, getattr(self, name), 0.0)
