"""Error transformation: from an error inside its funnel to one without bounds.

x = e/P, ε = T(x) = ½ ln((δ_L + x)/(δ_R − x)), for −δ_L < x < δ_R.

Source: Yang and Mahmoudian, Eqs. for ε, λ and κ. With x' = (e' − xP')/P,
ε' = T' x' and ε'' = κ + λ e'', where λ = T'/P and
κ = T'' x'² − T' (2x'P' + xP'')/P: the paper's expressions, shorter.

Deviation: outside the funnel the formula is the logarithm of a negative number, and
near the edge λ grows without bound, which switches the control law u ~ 1/λ off. Past
95 % of either bound T goes on as a straight line of the same slope, and the glider can
recover.
"""

import math

import equinox as eqx
import jax.numpy as jnp

from jaxglider.control.prescribed.performance import Bound
from jaxglider.core.containers import Container, Scalar, as_float
from jaxglider.core.numerics import log2
from jaxglider.core.sets import UNIT, UNIT_CLOSED


class TransformedError(eqx.Module):
    """One channel's transformed error and what its dynamics are made of.

    ε'' = κ + λ e''.

    Attributes:
        value: ε.
        rate: ε' [1/s].
        offset: κ [1/s²].
        gain: λ, per unit of the channel.
        gain_inverse: 1/λ, unit of the channel.
        gain_inverse_rate: d/dt (1/λ), unit of the channel per second.
    """

    value: Scalar
    rate: Scalar
    offset: Scalar
    gain: Scalar
    gain_inverse: Scalar
    gain_inverse_rate: Scalar


class ErrorTransformation(Container):
    """T(x) with linear tails; see the module's text.

    Attributes:
        lower: δ_L in (0, 1], the error stays above −δ_L P.
        upper: δ_R in (0, 1], the error stays below δ_R P.
        tail: share of either bound past which T is a straight line, in (0, 1).

    Raises:
        ValueError: a number is outside its interval.
    """

    lower: Scalar = eqx.field(
        converter=as_float, default=1.0, metadata={"set": UNIT_CLOSED}
    )
    upper: Scalar = eqx.field(
        converter=as_float, default=1.0, metadata={"set": UNIT_CLOSED}
    )
    tail: Scalar = eqx.field(
        converter=as_float, default=0.95, metadata={"set": UNIT, "tuned": False}
    )

    def __call__(
        self, error: Scalar, error_rate: Scalar, bound: Bound
    ) -> TransformedError:
        """Transform one channel.

        Args:
            error: e [m or rad].
            error_rate: e' [m/s or rad/s].
            bound: P, P', P'' now.
        """
        width, width1, width2 = bound.value, bound.rate, bound.acceleration
        # Divisions are slow: one by the width, one by the distances to both edges.
        narrow = 1.0 / width
        x = error * narrow
        x1 = (error_rate - x * width1) * narrow
        core = jnp.clip(x, -self.tail * self.lower, self.tail * self.upper)
        left, right = self.lower + core, self.upper - core
        span, product = self.lower + self.upper, 1.0 / (left * right)
        slope = 0.5 * span * product
        flat = left * right * (2.0 / span)
        curve = jnp.where(
            core == x, 0.5 * span * (left - right) * product * product, 0.0
        )
        ratio = left * left * product
        return TransformedError(
            value=0.5 * math.log(2.0) * log2(ratio) + slope * (x - core),
            rate=slope * x1,
            offset=curve * x1 * x1 - slope * (2.0 * x1 * width1 + x * width2) * narrow,
            gain=slope * narrow,
            gain_inverse=width * flat,
            gain_inverse_rate=width1 * flat - width * curve * x1 * flat * flat,
        )
