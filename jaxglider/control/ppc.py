"""Prescribed performance control, the paper's second baseline.

q = ε' + l₀ ε,  U = g⁻¹(−κ/λ + η_d'' − f − h d̂ − l₁ q − l₂ tanh q),
with l₁ = max(d/dt (1/λ), 0) + margin, so that d/dt (1/λ) − l₁ < 0.
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


class PPC(AbstractController):
    """Prescribed performance control.

    Attributes:
        model: design model, the designer's belief about the glider.
        funnel: performance functions and error transformations.
        l0: slope of the sliding surface [1/s].
        l1_margin: excess of l₁ over d/dt (1/λ), unit of the channel per second.
        l2: switching gain [m/s² or rad/s²].
        damping: damping of the allocation, one number per actuator.
        steering: way to steer; the paper's inversion by default.

    Raises:
        ValueError: a gain is not positive.
    """

    model: DesignModel
    funnel: Funnel
    l0: Channels[Scalar] = eqx.field(metadata={"set": POSITIVE})
    l1_margin: Channels[Scalar] = eqx.field(metadata={"set": POSITIVE})
    l2: Channels[Scalar] = eqx.field(metadata={"set": POSITIVE})
    damping: Command[Scalar] = eqx.field(
        default_factory=default_damping, metadata={"set": POSITIVE}
    )
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
        transformed = self.funnel.transform(error, rate, bounds)
        surface = map_fields(lambda l0, t: t.rate + l0 * t.value, self.l0, transformed)
        demand = map_fields(
            lambda acceleration, t, q, margin, l2: (
                acceleration
                - t.offset * t.gain_inverse
                - (jnp.maximum(t.gain_inverse_rate, 0.0) + margin) * q
                - l2 * jnp.tanh(q)
            ),
            reference.acceleration,
            transformed,
            surface,
            self.l1_margin,
            self.l2,
        )
        wanted = allocate(self.model, measurement, demand, self.damping, self.steering)
        return wanted, state, ControlRecord(error, surface)
