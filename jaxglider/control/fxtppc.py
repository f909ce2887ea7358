"""Fixed-time prescribed performance control, the paper's proposal.

With ε₁ = ε, ε₂ = ε' of each channel and s = ε₂ + ∫ A dt,

A   = k₁ (sig^{a}(ε₁) + ε₁ + sig^{a'}(ε₁)) + k₂ (sig^{b}(ε₂) + ε₂ + sig^{b'}(ε₂)),
u_s = (k₁ + k₂)(sig^{1+1/μ}(s) + s + sig^{1−1/μ}(s)),
U   = g⁻¹(−κ/λ + η_d'' − f − h d̂ − (A + u_s)/λ).

The exponents follow from ρ in one of two pairings; see `paper_exponents` and
`tian_exponents`. Deviation from the print: d̂ enters as h d̂.

With `hedging` η, what is asked for and not carried out is taken out of the integral,

s = ε₂ + ∫ (A − η λ ν_h) dt,   ν_h the `shortfall` of the steering,

so that s sees only what the law itself is to blame for, whatever kept the command back:
an actuator's end, rate or lag, or a bank that is large enough. Without, the integral
winds up while an actuator cannot follow. Source: pseudo-control hedging, Johnson and
Calise (2000), on a sliding surface instead of a reference model.
"""

import math
from collections.abc import Callable

import equinox as eqx
import jax
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
from jaxglider.control.prescribed.transform import TransformedError
from jaxglider.control.steering import INVERSION, AbstractSteering, Asked
from jaxglider.core.containers import Container, Scalar, as_float
from jaxglider.core.numerics import modulus_powers, signed_powers
from jaxglider.core.sets import ABOVE_ONE, K1_BELOW_K2, POSITIVE, SHARE, UNIT, Coupled
from jaxglider.signals import Channels, Command, Measurement, Reference, map_fields
from jaxglider.vehicle.design_model import DesignModel

Pair = tuple[Scalar, Scalar]


def paper_exponents(rho: Scalar) -> tuple[Pair, Pair]:
    """Exponents as the paper pairs them: for ε₁ and for ε₂.

    ρ/(2−ρ), ρ with k₁; (4−3ρ)/(2−ρ), (4−3ρ)/(3−2ρ) with k₂.
    """
    over = 4.0 - 3.0 * rho
    return (rho / (2.0 - rho), rho), (over / (2.0 - rho), over / (3.0 - 2.0 * rho))


def tian_exponents(rho: Scalar) -> tuple[Pair, Pair]:
    """Exponents as Tian, Zuo, Yan and Wang (Automatica 80, 2017) pair them.

    ρ/(2−ρ), (4−3ρ)/(2−ρ) with k₁; ρ, (4−3ρ)/(3−2ρ) with k₂.
    """
    over = 4.0 - 3.0 * rho
    return (rho / (2.0 - rho), over / (2.0 - rho)), (rho, over / (3.0 - 2.0 * rho))


EXPONENTS: dict[str, Callable[[Scalar], tuple[Pair, Pair]]] = {
    "paper": paper_exponents,
    "tian": tian_exponents,
}


SURFACE_CONSTANT = 2.0 * math.pi / (3.0 * math.sqrt(3.0))
"""The integral of 1/(y² + y + 1) over all y > 0, 1.2092."""

_K1_AND_K2 = Coupled(K1_BELOW_K2, "k1", "k2")


class ChannelGains(Container):
    """Gains of the fixed-time law on one channel.

    Attributes:
        k1: k₁ > 0, on the transformed error.
        k2: k₂ > 0, on its rate.
        rho: ρ in (0, 1), sets the exponents of the sliding surface.
        mu: μ > 1, sets the exponents 1 ± 1/μ of the reaching law.

    Raises:
        ValueError: a gain is outside its set.
    """

    k1: Scalar = eqx.field(converter=as_float, metadata={"set": _K1_AND_K2})
    k2: Scalar = eqx.field(converter=as_float, metadata={"set": _K1_AND_K2})
    rho: Scalar = eqx.field(converter=as_float, default=0.8, metadata={"set": UNIT})
    mu: Scalar = eqx.field(converter=as_float, default=2.0, metadata={"set": ABOVE_ONE})

    def settling_bound(self) -> Scalar:
        """Settling time of s from however far away [s]: 2π/(3√3) μ/(k₁ + k₂).

        It is exact. With k = k₁ + k₂ and y = |s|^{1/μ}, ds/s = μ dy/y, the time from
        infinity to zero under s' = −k (sig^{1+1/μ}(s) + s + sig^{1−1/μ}(s)) is

        ∫₀^∞ ds/(k s (y + 1 + 1/y)) = (μ/k) ∫₀^∞ dy/(y² + y + 1) = (μ/k) 2π/(3√3).

        The paper's 2μ/min(k₁, k₂) leaves the linear term out and takes the smaller gain
        twice. Both are bounds on s, not on the error, with the disturbance estimated
        and unlimited actuators; the smoothing δ of the powers stops s at |s| of δ.
        """
        return SURFACE_CONSTANT * self.mu / (self.k1 + self.k2)


class FxTPPCState(eqx.Module):
    """Memory of the law from tick to tick.

    Attributes:
        integral: ∫ A dt of each channel.
        asked: demand of the previous tick; None without hedging.
    """

    integral: Channels[Scalar]
    asked: Asked | None = None


class FxTPPC(AbstractController):
    """Fixed-time prescribed performance control.

    Attributes:
        model: design model, the designer's belief about the glider.
        funnel: performance functions and error transformations.
        gains: k₁, k₂, ρ, μ of each channel.
        damping: damping of the allocation, one number per actuator.
        smoothing: δ of the signed powers.
        exponents: the pairing, `paper_exponents` or `tian_exponents`.
        steering: way to steer; the paper's inversion by default.
        hedging: η in [0, 1], share of the shortfall that the integral of the surface is
            spared; None for the paper's law, which has no such thing.

    Raises:
        ValueError: a gain is outside its set.
    """

    model: DesignModel
    funnel: Funnel
    gains: Channels[ChannelGains]
    damping: Command[Scalar] = eqx.field(
        default_factory=default_damping, metadata={"set": POSITIVE}
    )
    smoothing: Scalar = eqx.field(
        converter=as_float, default=1e-3, metadata={"set": POSITIVE, "tuned": False}
    )
    exponents: Callable[[Scalar], tuple[Pair, Pair]] = eqx.field(
        static=True, default=paper_exponents
    )
    steering: AbstractSteering = INVERSION
    hedging: Scalar | None = eqx.field(
        converter=as_float, default=None, metadata={"set": SHARE}
    )

    def init(self) -> FxTPPCState:
        """The integral of the sliding surface, zero on each channel."""
        zero = jnp.zeros_like(self.smoothing)
        integral = Channels(zero, zero, zero)
        if self.hedging is None:
            return FxTPPCState(integral)
        return FxTPPCState(integral, Asked(Command(zero, zero, zero), zero))

    def step(
        self,
        state: FxTPPCState,
        measurement: Measurement,
        reference: Reference,
        bounds: Channels[Bound],
        dt: Scalar,
    ) -> tuple[Command[Scalar], FxTPPCState, ControlRecord]:
        """One tick; the integral is updated after the command is computed."""
        error, rate = steered_error(self.steering, self.model, measurement, reference)
        transformed = self.funnel.transform(error, rate, bounds)
        before = self._hedged(state, measurement, transformed, dt)
        law = map_fields(self._channel, self.gains, transformed, before)
        demand = map_fields(
            lambda acceleration, t, c: (
                acceleration - (t.offset + c.sliding + c.reaching) * t.gain_inverse
            ),
            reference.acceleration,
            transformed,
            law,
        )
        wanted = allocate(self.model, measurement, demand, self.damping, self.steering)
        integral = map_fields(
            lambda integral, c: integral + dt * c.sliding, before, law
        )
        record = ControlRecord(error, map_fields(lambda c: c.surface, law))
        asked = None if self.hedging is None else Asked(wanted, demand.heading)
        return wanted, FxTPPCState(integral, asked), record

    def _hedged(
        self,
        state: FxTPPCState,
        measurement: Measurement,
        transformed: Channels[TransformedError],
        dt: Scalar,
    ) -> Channels[Scalar]:
        """The integral of the surface without the shortfall of the previous tick."""
        if state.asked is None:
            return state.integral
        shortfall = self.steering.shortfall(self.model, measurement, state.asked)
        return spared(state.integral, transformed, shortfall, dt * self.hedging)

    @jax.named_scope("sliding_surface")
    def _channel(
        self, gains: ChannelGains, transformed: TransformedError, integral: Scalar
    ) -> "_ChannelLaw":
        e1, e2 = transformed.value, transformed.rate
        for_e1, for_e2 = self.exponents(gains.rho)
        a, a_prime = signed_powers(e1, for_e1, self.smoothing)
        b, b_prime = signed_powers(e2, for_e2, self.smoothing)
        s = e2 + integral
        return _ChannelLaw(
            sliding=gains.k1 * (a + e1 + a_prime) + gains.k2 * (b + e2 + b_prime),
            reaching=(gains.k1 + gains.k2) * reaching_law(s, gains.mu, self.smoothing),
            surface=s,
        )


class _ChannelLaw(eqx.Module):
    """A, u_s and s of one channel."""

    sliding: jax.Array
    reaching: jax.Array
    surface: jax.Array


def spared(
    integral: Channels[Scalar],
    transformed: Channels[TransformedError],
    shortfall: Channels[Scalar],
    share: Scalar,
) -> Channels[Scalar]:
    """The integral of the surface less a share of λ ν_h: pseudo-control hedging.

    Args:
        integral: ∫ A dt of each channel.
        transformed: transformed errors, which carry λ.
        shortfall: ν_h [m/s², rad/s²].
        share: η Δt [s].
    """
    return map_fields(
        lambda i, t, nu: i - share * t.gain * nu, integral, transformed, shortfall
    )


def reaching_law(s: Scalar, mu: Scalar, smoothing: Scalar) -> Scalar:
    """sig^{1+1/μ}(s) + s + sig^{1−1/μ}(s).

    s' = −k times this settles within 2π/(3√3) μ/k from anywhere.

    Args:
        s: sliding variable.
        mu: μ > 1.
        smoothing: δ of the signed powers.
    """
    (power,) = modulus_powers(s, (1.0 / mu,), smoothing)
    return s * (power + 1.0 + 1.0 / power)
