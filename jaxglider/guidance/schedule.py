"""Reference of the paper's first case: a schedule of gliding angles and headings."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import Container, Scalar, Series, as_float, concrete
from jaxglider.guidance.reference import AbstractReference, clipped_angle_of_attack
from jaxglider.signals import Channels, GliderState, Measurement, Reference


class Segment(eqx.Module):
    """A schedule at one instant.

    Attributes:
        number: number of the segment.
        clock: time since it began [s].
        depth: wanted depth [m].
        depth_rate: rate of the wanted depth [m/s].
        gliding_angle: ξ_d [rad], negative down.
        heading: ψ_d [rad].
    """

    number: jax.Array
    clock: Scalar
    depth: Scalar
    depth_rate: Scalar
    gliding_angle: Scalar
    heading: Scalar


class Schedule(Container):
    """Piecewise constant gliding angle, heading and depth rate.

    Attributes:
        start: beginnings of the segments [s]; the first at 0, increasing. The last
            segment goes on for ever.
        gliding_angle: ξ_d of each segment [rad], negative down.
        heading: ψ_d of each segment [rad].
        depth_rate: rate of the wanted depth in each segment [m/s], positive down.
        initial_depth: wanted depth at time 0 [m].

    Raises:
        ValueError: lengths differ, there is no segment, or the starts do not begin at
            zero and increase.
    """

    start: Series = eqx.field(converter=as_float)
    gliding_angle: Series = eqx.field(converter=as_float)
    heading: Series = eqx.field(converter=as_float)
    depth_rate: Series = eqx.field(converter=as_float)
    initial_depth: Scalar = eqx.field(converter=as_float, default=0.0)

    def __check_init__(self) -> None:
        lengths = {
            name: np.shape(getattr(self, name))
            for name in ("start", "gliding_angle", "heading", "depth_rate")
        }
        if len(set(lengths.values())) != 1 or any(
            len(s) != 1 or s[0] == 0 for s in lengths.values()
        ):
            raise ValueError(
                "Schedule needs start, gliding_angle, heading and depth_rate of one "
                f"length, at least 1; received shapes {lengths}."
            )
        start = concrete(self.start)
        if start is not None and (start[0] != 0.0 or np.any(np.diff(start) <= 0.0)):
            raise ValueError(
                "Schedule.start must begin at 0 and increase; "
                f"received {start.tolist()}."
            )

    def at(self, time: Scalar) -> Segment:
        """The schedule at one time [s]."""
        number = jnp.searchsorted(self.start, time, side="right") - 1
        clock = time - self.start[number]
        lasted = jnp.diff(self.start, append=self.start[-1:])
        reached = self.initial_depth + jnp.cumsum(self.depth_rate * lasted)
        begun = jnp.concatenate([self.initial_depth[None], reached[:-1]])
        rate = self.depth_rate[number]
        return Segment(
            number=number,
            clock=clock,
            depth=begun[number] + rate * clock,
            depth_rate=rate,
            gliding_angle=self.gliding_angle[number],
            heading=self.heading[number],
        )


class AttitudeSchedule(AbstractReference):
    """Follow a schedule; the funnel restarts with each of its segments.

    Attributes:
        schedule: gliding angle, heading and depth rate against time.
    """

    schedule: Schedule
    scheduled: ClassVar[bool] = True
    can_finish: ClassVar[bool] = False

    def plan(self, times: Series) -> Segment:
        """The schedule at each time."""
        return jax.vmap(self.schedule.at)(times)

    def init(self, state: GliderState) -> None:
        """No state: a schedule has no memory."""
        return None

    def step(
        self, state: None, planned: Segment, measurement: Measurement, dt: Scalar
    ) -> tuple[Reference, None]:
        """The planned segment, its gliding angle turned into a pitch."""
        zero = jnp.zeros_like(planned.depth)
        pitch = planned.gliding_angle + clipped_angle_of_attack(measurement.state)
        reference = Reference(
            position=Channels(planned.depth, pitch, planned.heading),
            rate=Channels(planned.depth_rate, zero, zero),
            acceleration=Channels(zero, zero, zero),
            clock=planned.clock,
            target=planned.number,
            finished=planned.number < 0,
        )
        return reference, state
