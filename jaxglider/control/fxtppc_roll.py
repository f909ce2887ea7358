"""The fixed-time law for gliders that roll under their moving mass.

A glider whose mass obeys mechanics hangs below it, φ → γ, and its hull turns no faster
than its tilted lift pulls it round. The paper's law knows neither: it asks for an angle
that the actuator cannot hold, waits for a turn that does not come, and its integral
runs on meanwhile. Here the mass angle that it asks for, γ_law, becomes

γ_asked = γ_law + a φ,
γ       = clip(γ_asked, ±γ_max) − b p,

φ in [−π, π): the mass carried along with the rolling hull, kept clear of the end of its
turn, and the roll damped. What is not carried out is taken out of the integral of the
surface,

s = ε₂ + ∫ (A − η λ ν_h) dt,    ν_h = g (U_applied − U_asked),

so that s sees only what the law itself is to blame for, whatever kept the command back:
the clip, the damping, or an actuator's end, rate or lag. The share of the roll, a φ, is
asked for: it is not hedged, and g a φ acts on s as a disturbance.

With a = b = η = 0 and γ_max beyond the actuator's end it is the paper's law.

Source: the hedge is that of Johnson and Calise, "Pseudo-control hedging: a new method
for adaptive control" (2000), on a sliding surface instead of a reference model.
"""

import math

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.controller import (
    AbstractController,
    ControlRecord,
    tracking_error,
)
from jaxglider.control.fxtppc import FxTPPC, FxTPPCState, spared
from jaxglider.control.prescribed.funnel import Funnel
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.steering import Asked, Inversion
from jaxglider.core.containers import Scalar, as_float
from jaxglider.core.numerics import saturate
from jaxglider.core.rotations import wrap
from jaxglider.core.sets import NOT_NEGATIVE, Interval
from jaxglider.signals import Channels, Command, Measurement, Reference
from jaxglider.vehicle.design_model import DesignModel


class RollAwareState(eqx.Module):
    """Memory from tick to tick.

    Attributes:
        integral: integral of the surface of each channel, the paper's law's own state.
        asked: U that the law asked for in the previous tick.
    """

    integral: Channels[Scalar]
    asked: Command[Scalar]


class RollAwareFxTPPC(AbstractController):
    """Fixed-time prescribed performance control that knows of the roll.

    Attributes:
        law: the paper's law.
        roll_share: a in [0, 1), share of the roll that the mass angle follows. The hull
            is righted by the rest, 1 − a.
        roll_damping: b ≥ 0, mass angle per roll rate [s].
        largest_angle: γ_max in (0, π/2], where the wanted mass angle ends [rad].
        hedging: η in [0, 1], share of what is not carried out that the integral of the
            surface is spared.

    Raises:
        ValueError: a gain is outside its set, or the law does not steer by inversion.
    """

    law: FxTPPC
    # From 1 on the mass rolls with the hull, and nothing rights it.
    roll_share: Scalar = eqx.field(
        converter=as_float,
        default=0.1,
        metadata={"set": Interval(0.0, 1.0, closed_low=True)},
    )
    roll_damping: Scalar = eqx.field(
        converter=as_float, default=1.0, metadata={"unit": "s", "set": NOT_NEGATIVE}
    )
    largest_angle: Scalar = eqx.field(
        converter=as_float,
        default=1.4,
        metadata={"unit": "rad", "set": Interval(0.0, math.pi / 2, closed_high=True)},
    )
    hedging: Scalar = eqx.field(
        converter=as_float,
        default=0.7,
        metadata={"set": Interval(0.0, 1.0, closed_low=True, closed_high=True)},
    )

    def __check_init__(self) -> None:
        if not isinstance(self.law, FxTPPC):
            kind = type(self.law).__name__
            raise ValueError(
                f"RollAwareFxTPPC.law must be an FxTPPC; received a {kind}."
            )
        if not isinstance(self.law.steering, Inversion):
            raise ValueError(
                "RollAwareFxTPPC.law must steer by inversion; received "
                f"{type(self.law.steering).__name__}. An FxTPPC that steers by bank "
                "knows of the roll itself: take it alone."
            )

    @property
    def model(self) -> DesignModel:
        """Design model of the paper's law."""
        return self.law.model

    @property
    def funnel(self) -> Funnel:
        """The law's performance functions and error transformations."""
        return self.law.funnel

    def init(self) -> RollAwareState:
        """The integral of the sliding surface, and no command yet."""
        zero = jnp.zeros_like(self.hedging)
        return RollAwareState(self.law.init().integral, Command(zero, zero, zero))

    def step(
        self,
        state: RollAwareState,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], RollAwareState, ControlRecord]:
        """One tick of the law, from a hedged integral."""
        error, rate = tracking_error(measurement, reference)
        transformed = self.funnel.transform(error, rate, bounds)
        asked = Asked(state.asked, jnp.zeros_like(self.hedging))
        shortfall = self.law.steering.shortfall(self.model, measurement, asked)
        share = dt * self.hedging
        integral = spared(state.integral, transformed, shortfall, share)
        wanted, following, record = self.law.step(
            FxTPPCState(integral), measurement, reference, bounds, dt
        )
        glider = measurement.state
        angle = wanted.mass_angle + self.roll_share * wrap(glider.roll)
        wish = Command(wanted.buoyancy_mass, wanted.mass_position, angle)
        steered = Command(
            wish.buoyancy_mass,
            wish.mass_position,
            saturate(angle, self.largest_angle) - self.roll_damping * glider.roll_rate,
        )
        return steered, RollAwareState(following.integral, wish), record
