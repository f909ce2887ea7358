"""Settings of a yo mission: phases, depths, surfacing and ends."""

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import (
    Container,
    Flag,
    Scalar,
    as_float,
    check_interval,
)
from jaxglider.guidance.phases import SURFACE, HalfYo, StopRules, SurfaceStay, Turning
from jaxglider.guidance.progress import YoState
from jaxglider.signals import Measurement, Reference

ABOVE = "The glider turns down at the top, which is above the bottom: depths are down."
"""Advice for a top below the bottom."""


class YoSettings(Container):
    """Settings of a yo mission.

    A mission that is over goes on to the surface at the end of its climb: there it is
    completed. Without any end of its own it lasts as long as the run.

    Attributes:
        dive: settings of the way down.
        climb: settings of the way up.
        bottom: depth at which the glider turns up [m].
        top: depth at which it turns down [m].
        altitude: height over the bottom at which it turns up [m], or None to look at
            the depth alone.
        altimeter_range: height up to which the altimeter sees the bottom [m].
        apogee: settings of the inflection at the bottom.
        inflection: settings of the inflection at the top.
        surface: settings of a stay at the surface.
        stop: rules that end the mission early.
        early_share: weight of the newest overshoot in its running mean, in [0, 1]; the
            glider turns that mean before the wanted depth. Zero: never early.
        early_most: largest distance that it turns early [m].
        yos: number of yos that end the mission, or None.
        duration: time after which the next climb ends the mission [s], or None.
        spiral: steering angle of the mass or the fin that is held under water [rad], in
            place of the course; None to follow it.
        spiral_flips: flag, the angle changes its sign in climbs: that of a mass has
            to, for the turn to go on the same way; that of a fin has not.

    Raises:
        ValueError: the top is not above the bottom, a number is negative, the dive does
            not sink or the climb does not rise.
    """

    dive: HalfYo
    climb: HalfYo
    bottom: Scalar = eqx.field(converter=as_float)
    top: Scalar = eqx.field(converter=as_float, default=3.0)
    altitude: Scalar | None = eqx.field(converter=as_float, default=None)
    altimeter_range: Scalar = eqx.field(converter=as_float, default=100.0)
    apogee: Turning = eqx.field(default_factory=lambda: Turning("pump"))
    inflection: Turning = eqx.field(
        default_factory=lambda: Turning("mass", longest=30.0)
    )
    surface: SurfaceStay = eqx.field(default_factory=SurfaceStay)
    stop: StopRules = eqx.field(default_factory=StopRules)
    early_share: Scalar = eqx.field(converter=as_float, default=0.25)
    early_most: Scalar = eqx.field(converter=as_float, default=25.0)
    yos: int | None = eqx.field(static=True, default=None)
    duration: Scalar | None = eqx.field(converter=as_float, default=None)
    spiral: Scalar | None = eqx.field(converter=as_float, default=None)
    spiral_flips: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        check_interval("YoSettings", "bottom", self.bottom, 0.0)
        check_interval("YoSettings", "altitude", self.altitude, 0.0)
        check_interval("YoSettings", "altimeter_range", self.altimeter_range, 0.0)
        check_interval("YoSettings", "duration", self.duration, 0.0)
        check_interval("YoSettings", "yos", self.yos, 1.0, closed_low=True)
        check_interval(
            "YoSettings", "top - bottom", self.top - self.bottom, high=0.0, remedy=ABOVE
        )
        check_interval(
            "YoSettings",
            "early_share",
            self.early_share,
            0.0,
            1.0,
            closed_low=True,
            closed_high=True,
        )
        check_interval(
            "YoSettings", "early_most", self.early_most, 0.0, closed_low=True
        )
        check_interval("YoSettings", "dive.buoyancy_mass", self.dive.buoyancy_mass, 0.0)
        check_interval(
            "YoSettings", "climb.buoyancy_mass", self.climb.buoyancy_mass, high=0.0
        )
        check_interval("YoSettings", "dive.angle", self.dive.angle, high=0.0)
        check_interval("YoSettings", "climb.angle", self.climb.angle, 0.0)

    def over(self, state: YoState, time: Scalar, course_done: Flag | bool) -> Flag:
        """Flag, the climb that is on, or is next, ends the mission.

        Args:
            state: progress so far.
            time: time since the start of the mission [s].
            course_done: flag, the last waypoint has been reached.
        """
        over = jnp.asarray(course_done)
        if self.yos is not None:
            # At the surface no yo is on that would count.
            now = jnp.where(state.phase == SURFACE, 0, 1)
            over = over | (state.yos + now >= self.yos)
        if self.duration is not None:
            over = over | (time >= self.duration)
        return over

    def due(self, state: YoState, time: Scalar, aim: Reference) -> Flag:
        """Flag, the glider is to surface at the end of its climb.

        Args:
            state: progress so far.
            time: time since the start of the mission [s].
            aim: reference of the course, with the waypoint made for.
        """
        stay, due = self.surface, jnp.asarray(False)
        if stay.every_yos is not None:
            due = due | (state.yos + 1 - state.surfaced_yos >= stay.every_yos)
        if stay.every is not None:
            due = due | (time - state.surfaced_at >= stay.every)
        if stay.at_waypoints:
            due = due | (aim.target != state.surfaced_target)
        return due

    def deep_enough(self, state: YoState, measurement: Measurement) -> Flag:
        """Flag, it is time to turn up, by depth or by altitude."""
        early = jnp.minimum(state.early_bottom, self.early_most)
        deep = state.depth >= self.bottom - early
        if self.altitude is None or measurement.altitude is None:
            return deep
        height = measurement.altitude
        return deep | (
            height <= jnp.minimum(self.altitude + early, self.altimeter_range)
        )
