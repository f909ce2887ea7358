"""A law of a user's own, in a file outside the packages: PD control with a trim."""

import equinox as eqx

from jaxglider import AbstractController, Command, ControlRecord, DesignModel, Funnel
from jaxglider.control import tracking_error
from jaxglider.core.containers import as_float
from jaxglider.core.sets import Interval


class Steered(AbstractController):
    """A command in proportion to each error and its rate, and a trimmed mass."""

    model: DesignModel | None = None
    # It only judges; a law that steers by its funnel would have it tuned.
    funnel: Funnel | None = eqx.field(default=None, metadata={"tuned": False})
    depth: float = eqx.field(converter=as_float, default=0.5)
    pitch: float = eqx.field(converter=as_float, default=0.08)
    heading: float = eqx.field(converter=as_float, default=0.5)
    lead: float = eqx.field(converter=as_float, default=2.0, metadata={"unit": "s"})
    trim: float = eqx.field(
        converter=as_float,
        default=0.01,
        metadata={"unit": "m", "set": Interval(-0.03, 0.03)},
    )

    def init(self):
        """It has no memory."""
        return None

    def step(self, state, measurement, reference, bounds, dt):
        """One tick of the law."""
        error, rate = tracking_error(measurement, reference)
        wanted = Command(
            -self.depth * (error.depth + self.lead * rate.depth),
            self.trim + self.pitch * (error.pitch + self.lead * rate.pitch),
            self.heading * (error.heading + self.lead * rate.heading),
        )
        return wanted, state, ControlRecord(error, rate)
