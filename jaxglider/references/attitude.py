"""Reference of the paper's first case: a schedule of gliding angles and headings."""

from typing import ClassVar

import jax
import jax.numpy as jnp

from jaxglider._types import Scalar, Series
from jaxglider.references.base import (
    AbstractReference,
    Schedule,
    Segment,
    angle_of_attack,
)
from jaxglider.signals import Channels, GliderState, Measurement, Reference


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
        """It has no memory."""
        return None

    def step(
        self, state: None, planned: Segment, measurement: Measurement, dt: Scalar
    ) -> tuple[Reference, None]:
        """The planned segment, its gliding angle turned into a pitch."""
        zero = jnp.zeros_like(planned.depth)
        pitch = planned.gliding_angle + angle_of_attack(measurement.state)
        reference = Reference(
            position=Channels(planned.depth, pitch, planned.heading),
            rate=Channels(planned.depth_rate, zero, zero),
            acceleration=Channels(zero, zero, zero),
            clock=planned.clock,
            target=planned.number,
            finished=planned.number < 0,
        )
        return reference, state
