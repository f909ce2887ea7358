"""Sliding-mode control, the paper's first baseline.

p = e' + c₀ e,  U = g⁻¹(−c₀ e' + η_d'' − f − h d̂ − c₁ p − c₂ tanh p).

The paper runs it without observer; with one, its d̂ enters as in the other laws.
"""

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.controller import (
    AbstractController,
    ControlRecord,
    allocate,
    default_damping,
    steered_error,
)
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.steering import INVERSION, AbstractSteering
from jaxglider.core.containers import Scalar
from jaxglider.core.sets import POSITIVE
from jaxglider.signals import Channels, Command, Measurement, Reference, map_fields
from jaxglider.vehicle.design_model import DesignModel


class SMC(AbstractController):
    """Sliding-mode control with a hyperbolic tangent in place of the signum.

    Attributes:
        model: design model, the designer's belief about the glider.
        c0: slope of the sliding surface [1/s].
        c1: linear reaching gain [1/s].
        c2: switching gain [m/s² or rad/s²].
        damping: damping of the allocation, one number per actuator.
        funnel: funnel that errors are judged by, or None; the law does not use it.
        steering: way to steer; the paper's inversion by default.

    Raises:
        ValueError: a gain is not positive.
    """

    model: DesignModel
    c0: Channels[Scalar] = eqx.field(metadata={"set": POSITIVE})
    c1: Channels[Scalar] = eqx.field(metadata={"set": POSITIVE})
    c2: Channels[Scalar] = eqx.field(metadata={"set": POSITIVE})
    damping: Command[Scalar] = eqx.field(
        default_factory=default_damping, metadata={"set": POSITIVE}
    )
    funnel: Funnel | None = eqx.field(default=None, metadata={"tuned": False})
    steering: AbstractSteering = INVERSION

    def init(self) -> None:
        """No state: the law has no memory."""
        return None

    def step(
        self,
        state: None,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], None, ControlRecord]:
        """One tick of the law."""
        error, rate = steered_error(self.steering, self.model, measurement, reference)
        surface = map_fields(lambda c0, e, e1: e1 + c0 * e, self.c0, error, rate)
        demand = map_fields(
            lambda acceleration, c0, e1, c1, p, c2: (
                acceleration - c0 * e1 - c1 * p - c2 * jnp.tanh(p)
            ),
            reference.acceleration,
            self.c0,
            rate,
            self.c1,
            surface,
            self.c2,
        )
        wanted = allocate(self.model, measurement, demand, self.damping, self.steering)
        return wanted, state, ControlRecord(error, surface)
