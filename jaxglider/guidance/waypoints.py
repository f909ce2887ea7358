"""Waypoint path with integral line-of-sight guidance.

Source: Yang and Mahmoudian, Eqs. of the guidance law, after Børhaug, Pavlov and
Pettersen 2008: ψ_d = χ − atan((y_e + k_I σ)/Λ), σ' = Λ y_e/(Λ² + (y_e + k_I σ)²), with
χ the azimuth of the leg and y_e the cross-track error, positive to starboard.

Deviations: the print leaves out χ. And ψ_d' is fed forward, as the theory's bounded
and known reference rate asks for: without it the proposed law leaves its funnel on the
first legs and never finishes the course.
"""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import (
    Counter,
    Scalar,
    Series,
    as_float,
    check_interval,
    concrete,
)
from jaxglider.core.numerics import select
from jaxglider.core.rotations import body_to_ned
from jaxglider.guidance.line_of_sight import LineOfSight
from jaxglider.guidance.reference import AbstractReference, clipped_angle_of_attack
from jaxglider.guidance.schedule import Schedule, Segment
from jaxglider.signals import Channels, GliderState, Measurement, Reference


class PathState(eqx.Module):
    """Progress of the glider along the path.

    Attributes:
        target: number of the waypoint being made for.
        integral: σ, reset at each switch.
        switched: time of the last switch [s].
        finished: the last waypoint has been reached.
    """

    target: jax.Array
    integral: Scalar
    switched: Scalar
    finished: jax.Array


class Leg(eqx.Module):
    """One leg of the path.

    Attributes:
        north: north coordinate of its beginning [m].
        east: east coordinate of its beginning [m].
        cosine: cosine of its azimuth.
        sine: sine of its azimuth.
        azimuth: χ [rad].
    """

    north: Scalar
    east: Scalar
    cosine: Scalar
    sine: Scalar
    azimuth: Scalar


class PlannedTick(eqx.Module):
    """Everything known of a tick beforehand.

    Attributes:
        time: start of the tick [s].
        vertical: the vertical schedule at that time.
    """

    time: jax.Array
    vertical: Segment


class WaypointPath(AbstractReference):
    """Straight legs from waypoint to waypoint, ended when the last one is reached.

    The next waypoint is taken, σ reset and the funnel restarted, when the current one
    is nearer than the switching radius; on request also when it comes abeam, farther
    off: a glider that has missed the circle would else follow the leg for ever (along-
    track switching in T. I. Fossen, Handbook of Marine Craft Hydrodynamics and Motion
    Control). Depth and gliding angle follow a schedule, whose headings are not used.

    Attributes:
        north: north coordinates of the waypoints [m].
        east: east coordinates of the waypoints [m].
        line_of_sight: guidance gains.
        vertical: schedule of gliding angle and depth rate.
        radius: switching distance [m].
        start_north: north coordinate of the first leg's beginning [m].
        start_east: east coordinate of the first leg's beginning [m].
        abeam: largest distance [m] at which a waypoint counts as reached once it is
            abeam or behind, seen along its leg; None for within the radius alone.

    Raises:
        ValueError: no waypoint, lengths that differ, two equal neighbours, or a
            distance that is not positive.
    """

    north: Series = eqx.field(converter=as_float)
    east: Series = eqx.field(converter=as_float)
    line_of_sight: LineOfSight
    vertical: Schedule
    radius: Scalar = eqx.field(converter=as_float)
    start_north: Scalar = eqx.field(converter=as_float, default=0.0)
    start_east: Scalar = eqx.field(converter=as_float, default=0.0)
    abeam: Scalar | None = eqx.field(converter=as_float, default=None)
    scheduled: ClassVar[bool] = False
    can_finish: ClassVar[bool] = True

    def __check_init__(self) -> None:
        shapes = np.shape(self.north), np.shape(self.east)
        if shapes[0] != shapes[1] or len(shapes[0]) != 1 or shapes[0][0] == 0:
            raise ValueError(
                "WaypointPath needs north and east of one length, at least 1 waypoint; "
                f"received shapes {shapes[0]} and {shapes[1]}."
            )
        check_interval("WaypointPath", "radius", self.radius, 0.0)
        if self.abeam is not None:
            check_interval("WaypointPath", "abeam", self.abeam, 0.0)
        points = [
            concrete(jnp.atleast_1d(v))
            for v in (self.start_north, self.north, self.start_east, self.east)
        ]
        if any(p is None for p in points):
            return
        legs = np.hypot(
            np.diff(np.concatenate(points[:2])),  # type: ignore[arg-type]
            np.diff(np.concatenate(points[2:])),  # type: ignore[arg-type]
        )
        if np.any(legs == 0.0):
            n = int(np.flatnonzero(legs == 0.0)[0])
            raise ValueError(
                f"WaypointPath: waypoint {n + 1} equals "
                f"{'the start of the path' if n == 0 else f'waypoint {n}'} "
                f"({float(points[1][n])}, {float(points[3][n])}); "  # type: ignore[index]
                "neighbours must differ: remove one."
            )

    @property
    def waypoints(self) -> int:
        """Number of waypoints to reach."""
        return len(self.north)

    def plan(self, times: Series) -> PlannedTick:
        """The vertical schedule at each time."""
        return PlannedTick(times, jax.vmap(self.vertical.at)(times))

    def init(self, state: GliderState) -> PathState:
        """On the first leg."""
        zero = jnp.zeros_like(state.north)
        return PathState(jnp.asarray(0, jnp.int32), zero, zero, jnp.asarray(False))

    def step(
        self,
        state: PathState,
        planned: PlannedTick,
        measurement: Measurement,
        dt: Scalar,
    ) -> tuple[Reference, PathState]:
        """Switch if the waypoint is reached, then guide along the leg."""
        s, vertical = measurement.state, planned.vertical
        path = self._switch(state, s, planned.time)
        leg = self._leg(path.target)
        off_north, off_east = s.north - leg.north, s.east - leg.east
        north_rate, east_rate, _ = body_to_ned(
            measurement.attitude, s.surge, s.sway, s.heave
        )
        if measurement.current is not None:
            north_rate = north_rate + measurement.current[0]
            east_rate = east_rate + measurement.current[1]
        relative, rate, integral_rate = self.line_of_sight(
            leg.cosine * off_east - leg.sine * off_north,
            leg.cosine * east_rate - leg.sine * north_rate,
            path.integral,
        )
        zero = jnp.zeros_like(relative)
        pitch = vertical.gliding_angle + clipped_angle_of_attack(s)
        reference = Reference(
            position=Channels(vertical.depth, pitch, leg.azimuth + relative),
            rate=Channels(vertical.depth_rate, zero, rate),
            acceleration=Channels(zero, zero, zero),
            clock=planned.time - path.switched,
            target=path.target,
            finished=path.finished,
        )
        following = PathState(
            path.target,
            path.integral + dt * integral_rate,
            path.switched,
            path.finished,
        )
        return reference, following

    def _switch(self, state: PathState, s: GliderState, time: Scalar) -> PathState:
        leg = self._leg(state.target)
        north = s.north - select(state.target, self.north)
        east = s.east - select(state.target, self.east)
        squared = north**2 + east**2
        near = squared <= self.radius**2
        if self.abeam is not None:
            passed = leg.cosine * north + leg.sine * east >= 0.0
            near = near | (passed & (squared <= self.abeam**2))
        last = state.target >= self.north.shape[0] - 1
        switch = near & ~last
        return PathState(
            jnp.where(switch, state.target + 1, state.target),
            jnp.where(switch, 0.0, state.integral),
            jnp.where(switch, time, state.switched),
            state.finished | (near & last),
        )

    def _leg(self, target: Counter) -> Leg:
        """The leg that ends at a waypoint."""
        before = jnp.maximum(target - 1, 0)
        first = target == 0
        north = jnp.where(first, self.start_north, select(before, self.north))
        east = jnp.where(first, self.start_east, select(before, self.east))
        ahead = select(target, self.north) - north
        aside = select(target, self.east) - east
        length = jnp.hypot(ahead, aside)
        azimuth = jnp.arctan2(aside, ahead)
        return Leg(north, east, ahead / length, aside / length, azimuth)
