"""Adaptive backstepping: a wanted rate first, then what brings it.

With e = η − η_d of each channel and z = e' + c₁ e, how far its rate is from the wanted
one, the acceleration that the design model is asked for is

a = η_d'' − c₁ e' − κ e − c₂ z − Θ̂,   Θ̂' = Γ z − σ Θ̂.

Then V = κ e²/2 + z²/2 + (Θ − Θ̂)²/2Γ falls as −κ c₁ e² − c₂ z² while σ is zero. Θ̂ is
what the model leaves out in the channel, a constant as far as the law knows; σ makes
it forget, so that it stays bounded while an actuator is at its end.

Source: J. Cao et al., 2016 (adaptive backstepping of a glider's pitch, κ = 1);
P. Ioannou and P. Kokotovic, 1983 (σ). Assumed: one regressor, a constant; κ is a gain,
for 1/s² is more than a glider's actuators can follow.
"""

import equinox as eqx

from jaxglider.control.controller import (
    ControlRecord,
    allocate,
    steered_error,
)
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.textbook.steered import AbstractSteeredLaw
from jaxglider.core.containers import Scalar
from jaxglider.core.sets import NOT_NEGATIVE, POSITIVE
from jaxglider.signals import (
    Channels,
    Command,
    Measurement,
    Reference,
    map_fields,
    zeros,
)


class Backstepping(AbstractSteeredLaw):
    """Adaptive backstepping on each channel.

    Attributes:
        c1: c₁ of each channel [1/s].
        c2: c₂ of each channel [1/s].
        coupling: κ of each channel [1/s²].
        adaptation: Γ of each channel [1/s²].
        leakage: σ of each channel [1/s].

    Raises:
        ValueError: a number is outside its set.
    """

    c1: Channels[Scalar] = eqx.field(
        default_factory=lambda: Channels(0.05, 0.1, 0.05), metadata={"set": POSITIVE}
    )
    c2: Channels[Scalar] = eqx.field(
        default_factory=lambda: Channels(0.2, 0.3, 0.15), metadata={"set": POSITIVE}
    )
    coupling: Channels[Scalar] = eqx.field(
        default_factory=lambda: Channels(0.001, 0.005, 0.001),
        metadata={"set": NOT_NEGATIVE},
    )
    adaptation: Channels[Scalar] = eqx.field(
        default_factory=lambda: Channels(0.0005, 0.003, 0.0003),
        metadata={"set": POSITIVE},
    )
    leakage: Channels[Scalar] = eqx.field(
        default_factory=lambda: Channels(0.005, 0.005, 0.01),
        metadata={"set": NOT_NEGATIVE},
    )

    def init(self) -> Channels[Scalar]:
        """Θ̂ of each channel, zero [m/s², rad/s²]."""
        return zeros(Channels, self.c1.depth)

    def step(
        self,
        state: Channels[Scalar],
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], Channels[Scalar], ControlRecord]:
        """One tick; Θ̂ is brought up to date after the command."""
        error, rate = steered_error(self.steering, self.model, measurement, reference)
        z = map_fields(lambda e, e1, c1: e1 + c1 * e, error, rate, self.c1)
        demand = map_fields(
            lambda acceleration, e, e1, z, c1, c2, kappa, theta: (
                acceleration - c1 * e1 - kappa * e - c2 * z - theta
            ),
            reference.acceleration,
            error,
            rate,
            z,
            self.c1,
            self.c2,
            self.coupling,
            state,
        )
        wanted = allocate(self.model, measurement, demand, self.damping, self.steering)
        following = map_fields(
            lambda theta, z, gamma, sigma: theta + dt * (gamma * z - sigma * theta),
            state,
            z,
            self.adaptation,
            self.leakage,
        )
        return wanted, following, ControlRecord(error, z)
