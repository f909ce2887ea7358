"""A law of one's own: a spring and a damper on each channel, in a file of its own."""

from typing import Any

import equinox as eqx

import jaxglider
from jaxglider.control import allocate, tracking_error
from jaxglider.signals import map_fields


def stiffness() -> jaxglider.Channels:
    """Spring constants to start from [1/s^2]."""
    return jaxglider.Channels(0.01, 0.05, 0.01)


def damping() -> jaxglider.Channels:
    """Dampers to start from [1/s]."""
    return jaxglider.Channels(0.2, 0.4, 0.2)


class Proportional(jaxglider.AbstractController):
    """The demanded acceleration is that of a spring and a damper.

    Attributes:
        model: belief of the designer about the glider.
        stiffness: spring constant of each channel [1/s^2].
        damping: damper of each channel [1/s].
        funnel: funnel that its errors are judged by; the law does not use it.
    """

    model: jaxglider.DesignModel
    stiffness: jaxglider.Channels = eqx.field(default_factory=stiffness)
    damping: jaxglider.Channels = eqx.field(default_factory=damping)
    funnel: jaxglider.Funnel | None = None

    def init(self) -> None:
        """It remembers nothing."""
        return None

    def step(
        self, state: Any, measurement: Any, reference: Any, bounds: Any, dt: Any
    ) -> tuple[Any, Any, jaxglider.ControlRecord]:
        """One tick: command, next state, and what is reported."""
        error, rate = tracking_error(measurement, reference)
        demand = map_fields(
            lambda k, c, e, r: -k * e - c * r, self.stiffness, self.damping, error, rate
        )
        regular = jaxglider.Command(1e-4, 1e-4, 1e-4)
        wanted = allocate(self.model, measurement, demand, regular)
        return wanted, state, jaxglider.ControlRecord(error, rate)
