"""Fixed-time backstepping: backstepping with a bound on the time that it takes.

With e = η − η_d of each channel, R_k(x) = k₁ sig^p(x) + k₂ sig^q(x), 0 < p < 1 < q, and
z = e' + R_k(e), how far its rate is from the wanted one, the acceleration that the
design model is asked for is

a = η_d'' − R_k'(e) e' − κ e − R_l(z).

s' = −R_k(s) is at zero after 1/(k₁ (1 − p)) + 1/(k₂ (q − 1)) at the latest, from
however far away; z has such a time with l, and then e with k.

Source: Luo et al., 2025 (fixed-time backstepping of a glider, κ = 1); A. Polyakov, IEEE
Trans. Automatic Control 57 (2012) 2106-2110 (the time). Assumed: powers smoothed about
zero, where R' would be infinite; κ is a gain; d̂ is the fixed-time observer's. What an
actuator does not carry out the theory does not know.
"""

import equinox as eqx

from jaxglider.control.controller import (
    ControlRecord,
    allocate,
    steered_error,
)
from jaxglider.control.prescribed.performance import Bound
from jaxglider.control.textbook.steered import AbstractSteeredLaw
from jaxglider.core.containers import Container, Scalar, as_float
from jaxglider.core.numerics import modulus_powers, signed_powers
from jaxglider.core.sets import ABOVE_ONE, NOT_NEGATIVE, POSITIVE, UNIT
from jaxglider.signals import Channels, Command, Measurement, Reference, map_fields


class Reaching(Container):
    """R(x) = k₁ sig^p(x) + k₂ sig^q(x), which brings x to zero in a fixed time.

    Attributes:
        k1: k₁ > 0, of the power below one.
        k2: k₂ > 0, of the power above one.
        p: p in (0, 1).
        q: q > 1.

    Raises:
        ValueError: a number is outside its set.
    """

    k1: Scalar = eqx.field(converter=as_float, metadata={"set": POSITIVE})
    k2: Scalar = eqx.field(converter=as_float, metadata={"set": POSITIVE})
    p: Scalar = eqx.field(converter=as_float, default=0.8, metadata={"set": UNIT})
    q: Scalar = eqx.field(converter=as_float, default=1.2, metadata={"set": ABOVE_ONE})

    def settling_bound(self) -> Scalar:
        """Time to zero from however far away [s]: 1/(k₁ (1 − p)) + 1/(k₂ (q − 1))."""
        return 1.0 / (self.k1 * (1.0 - self.p)) + 1.0 / (self.k2 * (self.q - 1.0))

    def of(self, x: Scalar, smoothing: Scalar) -> Scalar:
        """R(x).

        Args:
            x: quantity that is to go to zero.
            smoothing: δ of the signed powers.
        """
        low, high = signed_powers(x, (self.p, self.q), smoothing)
        return self.k1 * low + self.k2 * high

    def slope(self, x: Scalar, smoothing: Scalar) -> Scalar:
        """R'(x): of the smoothed x (x² + δ²)^((a−1)/2), (a x² + δ²)(x² + δ²)^((a−3)/2).

        Args:
            x: quantity that is to go to zero.
            smoothing: δ of the signed powers.
        """
        low, high = modulus_powers(x, (self.p - 3.0, self.q - 3.0), smoothing)
        square, least = x * x, smoothing * smoothing
        return self.k1 * low * (self.p * square + least) + self.k2 * high * (
            self.q * square + least
        )


class FixedTimeBackstepping(AbstractSteeredLaw):
    """Fixed-time backstepping on each channel.

    Attributes:
        outer: R_k of each channel, on the error.
        inner: R_l of each channel, on the rate.
        coupling: κ of each channel [1/s²].
        smoothing: δ of the signed powers.

    Raises:
        ValueError: a number is outside its set.
    """

    outer: Channels[Reaching] = eqx.field(
        default_factory=lambda: Channels(
            Reaching(0.03, 0.03), Reaching(0.06, 0.06), Reaching(0.02, 0.02)
        )
    )
    inner: Channels[Reaching] = eqx.field(
        default_factory=lambda: Channels(
            Reaching(0.1, 0.1), Reaching(0.15, 0.15), Reaching(0.06, 0.06)
        )
    )
    coupling: Channels[Scalar] = eqx.field(
        default_factory=lambda: Channels(0.001, 0.005, 0.001),
        metadata={"set": NOT_NEGATIVE},
    )
    smoothing: Scalar = eqx.field(
        converter=as_float, default=0.01, metadata={"set": POSITIVE, "tuned": False}
    )

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

        def channel(
            outer: Reaching, inner: Reaching, kappa: Scalar, e: Scalar, e1: Scalar
        ) -> tuple[Scalar, Scalar]:
            z = e1 + outer.of(e, self.smoothing)
            slope = outer.slope(e, self.smoothing) * e1
            return -slope - kappa * e - inner.of(z, self.smoothing), z

        law = map_fields(channel, self.outer, self.inner, self.coupling, error, rate)
        demand = map_fields(lambda a, c: a + c[0], reference.acceleration, law)
        wanted = allocate(self.model, measurement, demand, self.damping, self.steering)
        return wanted, state, ControlRecord(error, map_fields(lambda c: c[1], law))
