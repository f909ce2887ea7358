"""Yos: dive, inflection, climb, inflection, and the surface now and then.

The phases change at control ticks by the *measured* depth, or by the altitude over the
bottom. Depth is not tracked: each phase has a ballast, and pitch and heading are what
the law controls. The heading is that of any other reference, a route say.

Left out: the glider knows its position under water; dead reckoning is navigation's.
"""

import dataclasses
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Flag, Scalar, Series
from jaxglider.guidance import phases as names
from jaxglider.guidance.orders import by_phase, orders_of
from jaxglider.guidance.progress import (
    YoState,
    arrived,
    counted,
    listened,
    regulated,
    turned_over,
)
from jaxglider.guidance.reference import AbstractReference, clipped_angle_of_attack
from jaxglider.guidance.settings import YoSettings
from jaxglider.signals import (
    Channels,
    GliderState,
    Measurement,
    Orders,
    Reference,
    output_rates,
)


class PlannedYo(NamedTuple):
    """Everything known of a tick beforehand: its start [s], and the course's plan."""

    time: Any
    course: Any


class Yo(AbstractReference):
    """Fly yos along a course until a number of them, a time, or the course is done.

    Attributes:
        course: reference whose heading is followed: a schedule, a path of waypoints.
        settings: phases, depths, surfacing and ends.
    """

    course: AbstractReference
    settings: YoSettings
    scheduled: ClassVar[bool] = False
    can_finish: ClassVar[bool] = True
    phased: ClassVar[bool] = True

    @property
    def waypoints(self) -> int | None:
        """Number of waypoints of the course."""
        return self.course.waypoints

    def plan(self, times: Series) -> PlannedYo:
        """The times, and the plan of the course."""
        return PlannedYo(times, self.course.plan(times))

    def init(self, state: GliderState) -> YoState:
        """At the surface for the first stay, which may last no time at all."""
        zero = jnp.zeros_like(state.depth)
        none = jnp.asarray(0, jnp.int32)
        return YoState(
            phase=jnp.asarray(names.SURFACE, jnp.int32),
            entered=zero,
            half=zero,
            yos=none,
            surfaced_yos=none,
            surfaced_at=zero,
            surfaced_target=none,
            depth=state.depth,
            silent=zero,
            rate=zero,
            begun=state.depth,
            trigger=state.depth,
            extreme=state.depth,
            early_bottom=zero,
            early_top=zero,
            turned=jnp.asarray(False),
            best=state.depth,
            hovering=zero,
            stalled=zero,
            dive_ballast=zero + self.settings.dive.buoyancy_mass,
            climb_ballast=zero + self.settings.climb.buoyancy_mass,
            ordered=zero + self.settings.surface.buoyancy_mass,
            pump=zero,
            mass=zero,
            status=none,
            course=self.course.init(state),
        )

    def step(
        self, state: YoState, planned: PlannedYo, measurement: Measurement, dt: Scalar
    ) -> tuple[Reference, YoState]:
        """Change the phase if it is time, then say what is wanted in it."""
        aim, course = self.course.step(state.course, planned.course, measurement, dt)
        stop = self.settings.stop
        seen = counted(listened(state, measurement, stop, dt), stop, dt)
        ended = self._ended(seen, measurement)
        turned = self._turned(ended, measurement, planned.time, aim, dt)
        halves = self.settings.dive, self.settings.climb
        turned = regulated(turned, halves, dt)
        orders = orders_of(self.settings, turned)
        reference = self._reference(turned, measurement, aim, orders)
        at_surface = turned.phase == names.SURFACE
        following = dataclasses.replace(
            turned,
            entered=turned.entered + dt,
            half=turned.half + dt,
            ordered=orders.buoyancy_mass,
            pump=measurement.applied.buoyancy_mass,
            mass=measurement.applied.mass_position,
            # A glider that drifts at the surface does not add up its way off the leg.
            course=jax.tree.map(
                lambda old, new: jnp.where(at_surface, old, new), state.course, course
            ),
        )
        return reference, following

    def status(self, state: YoState) -> jax.Array:
        """Number of the end of the mission so far."""
        return state.status

    def final_status(self, status: jax.Array) -> jax.Array:
        """A mission that is still on at the end of the run has not come to its end."""
        plan = self.settings
        ends = plan.yos is not None or plan.duration is not None or self._has_route()
        left = names.UNFINISHED if ends else names.COMPLETED
        return jnp.where(status == names.UNDER_WAY, left, status)

    def _has_route(self) -> bool:
        return self.settings.spiral is None and self.course.can_finish

    def _ended(self, state: YoState, measurement: Measurement) -> YoState:
        """The status, once something has ended the mission early."""
        rules: list[tuple[Flag, int]] = [
            (state.hovering >= self.settings.stop.hover_time, names.HOVER),
            (state.stalled >= self.settings.stop.stall_time, names.STALL),
        ]
        if measurement.charge is not None:
            rules.insert(0, (measurement.charge <= 0.0, names.BATTERY_EMPTY))
        if measurement.altitude is not None:
            aground = measurement.aground
            if aground is None:
                aground = measurement.altitude <= 0.0
            rules.insert(0, (aground, names.BOTTOM))
        status = state.status
        for holds, number in rules:
            fresh = (status == names.UNDER_WAY) & holds
            status = jnp.where(fresh, number, status)
        return dataclasses.replace(state, status=status)

    def _turned(
        self,
        state: YoState,
        measurement: Measurement,
        time: Scalar,
        aim: Reference,
        dt: Scalar,
    ) -> YoState:
        """The state in the phase that this tick is flown in."""
        phase, plan = state.phase, self.settings
        done = aim.finished if self._has_route() else False
        over = plan.over(state, time, done)
        up = over | plan.due(state, time, aim)
        stay = jnp.where(state.yos == 0, plan.surface.first, plan.surface.duration)
        early_top = jnp.minimum(state.early_top, plan.early_most)
        leaves = {
            names.SURFACE: state.entered >= stay,
            names.DIVE: plan.deep_enough(state, measurement),
            names.APOGEE: arrived(state, measurement, plan.apogee, dt),
            names.CLIMB: jnp.where(
                up,
                state.depth <= plan.surface.depth,
                state.depth <= plan.top + early_top,
            ),
            names.INFLECTION: arrived(state, measurement, plan.inflection, dt),
        }
        after: dict[int, Any] = {
            names.SURFACE: names.INFLECTION,
            names.DIVE: names.APOGEE,
            names.APOGEE: names.CLIMB,
            names.CLIMB: jnp.where(up, names.SURFACE, names.INFLECTION),
            names.INFLECTION: names.DIVE,
        }
        following = phase
        for number, leaving in leaves.items():
            following = jnp.where((phase == number) & leaving, after[number], following)
        surfaced = (following == names.SURFACE) & (phase == names.CLIMB)
        # One tick after it came up, so that the surfacing still counts.
        completed = (phase == names.SURFACE) & over & (state.status == names.UNDER_WAY)
        halves = plan.dive, plan.climb
        state = turned_over(state, following, halves, plan.early_share)
        return dataclasses.replace(
            state,
            status=jnp.where(completed, names.COMPLETED, state.status),
            surfaced_yos=jnp.where(surfaced, state.yos, state.surfaced_yos),
            surfaced_at=jnp.where(phase == names.SURFACE, time, state.surfaced_at),
            surfaced_target=jnp.where(surfaced, aim.target, state.surfaced_target),
        )

    def _reference(
        self, state: YoState, measurement: Measurement, aim: Reference, orders: Orders
    ) -> Reference:
        """Depth as it is, the pitch of the phase, the heading of the course."""
        s, rates = measurement.state, output_rates(measurement)
        alpha = clipped_angle_of_attack(s)
        plan = self.settings
        dive, climb = (
            half.angle + alpha if half.of_path else half.angle
            for half in (plan.dive, plan.climb)
        )
        turns = (plan.apogee.angle, climb), (plan.inflection.angle, dive)
        apogee, inflection = (after if own is None else own for own, after in turns)
        pitch = by_phase(
            state.phase, plan.surface.angle, dive, apogee, climb, inflection
        )
        zero = jnp.zeros_like(pitch)
        # Nobody steers at the surface, or in a spiral: the heading is as it should be.
        free = (state.phase == names.SURFACE) | (plan.spiral is not None)
        return Reference(
            position=Channels(
                s.depth, pitch, jnp.where(free, s.heading, aim.position.heading)
            ),
            rate=Channels(
                rates.depth, zero, jnp.where(free, rates.heading, aim.rate.heading)
            ),
            acceleration=Channels(zero, zero, zero),
            clock=state.half,
            target=aim.target if self._has_route() else state.yos,
            finished=state.status != names.UNDER_WAY,
            orders=orders,
        )
