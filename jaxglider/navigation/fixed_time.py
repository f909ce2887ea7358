"""The fixed-time extended state observer on the design model, stepped implicitly.

With e = y − ŷ, the known f from the design model, and sig^a(x) = |x|^a sgn x,

ŷ'  = ŷ_1 + φ₁(e),   ŷ_1' = f + d̂ + φ₂(e),   d̂' = φ₃(e),
φ_i = k_i sig^{a_i}(e) + κ_i sig^{b_i}(e),   a_i = i a − (i − 1),   b_i = i b − (i − 1),

a < 1 < b: terms in a end in finite time near zero, those in b far from it, together in
a time that no start exceeds. k = (3ω, 3ω², ω³) and κ the same of ω∞ are the polynomials
(s + ω)³: Hurwitz whatever ω is.

Deviation: readings come every T seconds, and the explicit step is unstable there for
any gain worth having. The step is implicit: with b the surprise,

e + T φ₁(e) + T² φ₂(e) + T³ φ₃(e) = b,

whose left side rises with slope one or more: one root, with a derivative by the
implicit function theorem. Powers are smoothed as everywhere.

Source: M. Basin, P. Yu and Y. Shtessel, IET Control Theory & Applications 11 (2017)
1144-1152, for the form and the bound; the term in sgn e, for a d that keeps changing,
is left out: at these periods it would be noise.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxglider.core.containers import Scalar, as_float
from jaxglider.core.numerics import implicit_root, modulus_powers
from jaxglider.core.sets import POSITIVE, Interval
from jaxglider.navigation.output_observer import Correction, OutputObserver
from jaxglider.navigation.sensing.readings import Sensed
from jaxglider.signals import map_fields

_ROUNDS = 8


class FixedTimeStateObserver(OutputObserver):
    """The fixed-time extended state observer.

    Attributes:
        near: ω of each output, of the terms that act near zero [rad/s].
        far: ω∞ of each output, of those that act far from it [rad/s].
        low: a in (2/3, 1).
        high: b in (1, 3/2).
        smoothing: δ of the signed powers [m, rad].

    Raises:
        ValueError: a number is outside its set.
    """

    near: Sensed[Scalar] = eqx.field(metadata={"set": POSITIVE})
    far: Sensed[Scalar] = eqx.field(metadata={"set": POSITIVE})
    low: Scalar = eqx.field(
        converter=as_float, default=0.9, metadata={"set": Interval(2.0 / 3.0, 1.0)}
    )
    high: Scalar = eqx.field(
        converter=as_float, default=1.1, metadata={"set": Interval(1.0, 1.5)}
    )
    smoothing: Scalar = eqx.field(
        converter=as_float, default=1e-3, metadata={"set": POSITIVE, "tuned": False}
    )

    knows_model = True

    def corrections(
        self, surprises: Sensed[Scalar], intervals: Sensed[Scalar]
    ) -> Sensed[Correction]:
        """One implicit step of each output."""

        def one(near: Scalar, far: Scalar, e: Scalar, t: Scalar) -> Correction:
            gains = near * t, far * t, self.low, self.high, self.smoothing
            root = correction_root(e, gains)
            first, second, third = _terms(root, gains)
            return Correction(
                first + second + third, (second + third) / t, third / (t * t)
            )

        return map_fields(one, self.near, self.far, surprises, intervals)

    def settling_bound(self) -> Sensed[float]:
        """Time after which no error is left, wherever it began [s].

        λ^ρ/(r ρ) + 1/(r' σ Υ^σ) of the continuous observer and a constant d, with
        ρ = 1 − a, σ = b − 1, λ the largest eigenvalue of P, r = 1/λ(P), r' = 1/λ(P'),
        Υ the smallest of P'; P and P' solve P A + Aᵀ P = −I for k and κ.
        """
        low, high = float(self.low), float(self.high)

        def one(near: Scalar, far: Scalar) -> float:
            spectra = (np.linalg.eigvalsh(_lyapunov(float(x))) for x in (near, far))
            (*_, most), (least, _, most_far) = spectra
            rho, sigma = 1.0 - low, high - 1.0
            return float(most ** (1.0 + rho) / rho + most_far / (sigma * least**sigma))

        return Sensed(
            *(
                one(n, f)
                for n, f in zip(self.near.fields(), self.far.fields(), strict=True)
            )
        )


def correction_root(surprise: Scalar, gains: tuple[Scalar, ...]) -> Scalar:
    """e of e + T φ₁(e) + T² φ₂(e) + T³ φ₃(e) = b.

    By Newton's method on r = e/b in logarithms, in which the left side is a sum of
    exponentials: convex, so that it comes down upon the root from r = 1.

    Args:
        surprise: b.
        gains: ω T, ω∞ T, a, b and the smoothing.
    """
    fixed, b = lax.stop_gradient((gains, surprise))
    share = jnp.ones_like(b)
    for _ in range(_ROUNDS):
        value, slope = _left_side(b * share, fixed)
        # Of size one where b is zero: the left side is e times something positive.
        ratio = jnp.where(b == 0.0, slope, value / jnp.where(b == 0.0, 1.0, b))
        steepness = jnp.where(b == 0.0, 1.0, slope * share / ratio)
        share = share * jnp.exp(-jnp.log(ratio) / jnp.maximum(steepness, 0.3))
        share = jnp.clip(share, 1e-9, 1.0)
    return implicit_root(_left_side, b * share, surprise, gains)


def _left_side(e: Scalar, gains: tuple[Scalar, ...]) -> tuple[Scalar, Scalar]:
    """The left side and its slope."""

    def value(x: Scalar) -> Scalar:
        return x + sum(_terms(x, gains))

    return jax.jvp(value, (e,), (jnp.ones_like(e),))


def _terms(e: Scalar, gains: tuple[Scalar, ...]) -> tuple[Scalar, Scalar, Scalar]:
    """T φ₁(e), T² φ₂(e) and T³ φ₃(e)."""
    near, far, low, high, smoothing = gains
    orders = [n * a - n for a in (low, high) for n in (1.0, 2.0, 3.0)]
    powers = modulus_powers(e, orders, smoothing)
    weights = [part for x in (near, far) for part in (3.0 * x, 3.0 * x * x, x * x * x)]
    first, second, third, *others = (
        w * e * p for w, p in zip(weights, powers, strict=True)
    )
    return first + others[0], second + others[1], third + others[2]


def _lyapunov(omega: float) -> np.ndarray:
    """P of P A + Aᵀ P = −I for the polynomial (s + ω)³."""
    from scipy import linalg  # nothing that flies needs it

    a = np.array(
        [[-3.0 * omega, 1.0, 0.0], [-3.0 * omega**2, 0.0, 1.0], [-(omega**3), 0.0, 0.0]]
    )
    solved: np.ndarray = linalg.solve_continuous_lyapunov(a.T, -np.eye(3))
    return solved
