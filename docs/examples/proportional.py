"""A law of one's own, in a file of its own: a spring and a damper on each channel."""

from typing import Any

import equinox as eqx

import jaxglider
from jaxglider.control import allocate, tracking_error
from jaxglider.control.controller import default_damping
from jaxglider.signals import map_fields


class Proportional(jaxglider.AbstractController):
    """The demanded acceleration is that of a spring and a damper, -k e - c e'.

    Attributes:
        model: belief of the designer about the glider.
        stiffness: spring constant k of each channel [1/s^2].
        friction: damper c of each channel [1/s].
        damping: damping of the allocation, one number for each actuator.
        funnel: funnel that its errors are judged by; the law does not use it.
    """

    model: jaxglider.DesignModel
    stiffness: jaxglider.Channels = eqx.field(
        default_factory=lambda: jaxglider.Channels(0.01, 0.05, 0.01)
    )
    friction: jaxglider.Channels = eqx.field(
        default_factory=lambda: jaxglider.Channels(0.2, 0.4, 0.2)
    )
    damping: jaxglider.Command = eqx.field(default_factory=default_damping)
    funnel: jaxglider.Funnel | None = eqx.field(default=None, metadata={"tuned": False})

    def init(self) -> None:
        """It remembers nothing."""
        return None

    def step(
        self, state: Any, measurement: Any, reference: Any, bounds: Any, dt: Any
    ) -> tuple[Any, Any, jaxglider.ControlRecord]:
        """One tick: command, next state, and what is reported."""
        error, rate = tracking_error(measurement, reference)
        demand = map_fields(
            lambda k, c, e, r: -k * e - c * r,
            self.stiffness,
            self.friction,
            error,
            rate,
        )
        wanted = allocate(self.model, measurement, demand, self.damping)
        return wanted, state, jaxglider.ControlRecord(error, rate)
