"""Finite-time performance functions: how wide the funnel is, t* after its restart.

A performance function P(t*) is positive, falls strictly until the settling time T, and
is its final bound P_∞ from then on. All forms here are built on z = T/(T − t*), which
runs from 1 to ∞.

Source: Yang and Mahmoudian, Eqs. for the proposed and the original function, after Liu,
Liu and Jing 2018. Near T each form is below rounding while its factors overflow; past
z = Z_LIMIT it is replaced by its limit, so value and gradient stay finite.
"""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import (
    Container,
    Scalar,
    as_float,
    check_interval,
    concrete,
)
from jaxglider.core.sets import FROM_ONE, POSITIVE, SECH_ABOVE_BOUND, Coupled

_EXPONENT_LIMIT = 40.0
"""Past this exponent the falling part, e^(−40) ≈ 4e-18, is below double rounding."""


class Bound(eqx.Module):
    """A performance function and its rates at one instant.

    Attributes:
        value: P, in the unit of its channel.
        rate: P' [1/s of that].
        acceleration: P'' [1/s² of that].
        settled: t* is past the settling time.
    """

    value: Scalar
    rate: Scalar
    acceleration: Scalar
    settled: Any


_INITIAL_AND_BOUND = Coupled(SECH_ABOVE_BOUND, "initial", "final_bound")


def _number(**metadata: Any) -> Any:
    return eqx.field(converter=as_float, metadata=metadata)


class AbstractPerformanceFunction(Container):
    """A finite-time performance function of the time since the funnel's restart."""

    @abstractmethod
    def __call__(self, clock: Scalar) -> Bound:
        """P, P' and P'' at t* [s], t* ≥ 0."""


class SechFunction(AbstractPerformanceFunction):
    """P = sech(sech(P₀) T/(T − t*)) + P_∞ for t* < T, else P_∞: the paper's proposal.

    Attributes:
        initial: P₀, shapes the start: P(0) = sech(sech(P₀)) + P_∞.
        final_bound: P_∞, in the unit of its channel.
        settling_time: T [s].

    Raises:
        ValueError: a number is not positive, or sech(P₀) > P_∞ does not hold.
    """

    initial: Scalar = _number(set=_INITIAL_AND_BOUND)
    final_bound: Scalar = _number(unit="channel", set=_INITIAL_AND_BOUND)
    settling_time: Scalar = _number(unit="s", set=POSITIVE)

    def __check_init__(self) -> None:
        initial = concrete(self.initial)
        # What is not finite is refused by name, for all fields alike.
        if initial is not None and np.all(np.isfinite(initial)):
            check_interval(
                "SechFunction",
                "final_bound",
                self.final_bound,
                0.0,
                float(np.min(1.0 / np.cosh(initial))),
                remedy="The theory asks for sech(initial) > final_bound: "
                "lower final_bound or initial.",
            )

    def __call__(self, clock: Scalar) -> Bound:
        """P, P' and P'' at t* [s]."""
        slope = 1.0 / jnp.cosh(self.initial)
        return _sech_bound(self, clock, slope, 1.0)


class HalfSechFunction(AbstractPerformanceFunction):
    """P = ½ sech(P₀ T/(T − t*)) + P_∞ for t* < T, else P_∞: the PPC baseline's.

    The paper prints it as exp(y)/(1 + exp²(y)), which is ½ sech(y). It starts at
    ½ + P_∞ at most, so "the same initial value" as the proposed form is out of reach.

    Attributes:
        initial: P₀ > 0.
        final_bound: P_∞, in the unit of its channel.
        settling_time: T [s].

    Raises:
        ValueError: a number is not positive.
    """

    initial: Scalar = _number(set=POSITIVE)
    final_bound: Scalar = _number(unit="channel", set=POSITIVE)
    settling_time: Scalar = _number(unit="s", set=POSITIVE)

    def __call__(self, clock: Scalar) -> Bound:
        """P, P' and P'' at t* [s]."""
        return _sech_bound(self, clock, self.initial, 0.5)


class ExponentialFunction(AbstractPerformanceFunction):
    """P = (P₀ − t*/T) exp(1 − T/(T − t*)) + P_∞ for t* < T, else P_∞.

    The original form of Liu, Liu and Jing; P(0) = P₀ + P_∞. It falls all the way only
    for P₀ ≥ 1: below that it dips under P_∞ and comes back.

    Attributes:
        initial: P₀ ≥ 1.
        final_bound: P_∞, in the unit of its channel.
        settling_time: T [s].

    Raises:
        ValueError: P₀ below 1, or another number not positive.
    """

    initial: Scalar = _number(set=FROM_ONE)
    final_bound: Scalar = _number(unit="channel", set=POSITIVE)
    settling_time: Scalar = _number(unit="s", set=POSITIVE)

    def __call__(self, clock: Scalar) -> Bound:
        """P, P' and P'' at t* [s]."""
        z, z1, z2, falling = _stretched(clock, self.settling_time, _EXPONENT_LIMIT)
        duration = self.settling_time
        height = self.initial - (1.0 - 1.0 / z)
        decay = jnp.exp(1.0 - z)
        rate = decay * (-1.0 / duration - height * z1)
        curve = decay * (2.0 * z1 / duration + height * (z1 * z1 - z2))
        return _switched(self, clock, falling, decay * height, rate, curve)


def _sech_bound(
    function: SechFunction | HalfSechFunction,
    clock: Scalar,
    slope: Scalar,
    scale: float,
) -> Bound:
    """scale · sech(slope · z) + P_∞ and its rates."""
    z, z1, z2, falling = _stretched(
        clock, function.settling_time, _EXPONENT_LIMIT / slope
    )
    decay = jnp.exp(-slope * z)
    sech = 2.0 * decay / (1.0 + decay * decay)
    tanh = (1.0 - decay * decay) / (1.0 + decay * decay)
    y1, y2 = slope * z1, slope * z2
    rate = -sech * tanh * y1
    curve = sech * ((tanh * tanh - sech * sech) * y1 * y1 - tanh * y2)
    return _switched(
        function, clock, falling, scale * sech, scale * rate, scale * curve
    )


def _stretched(
    clock: Scalar, duration: Scalar, limit: Scalar | float
) -> tuple[Scalar, Scalar, Scalar, Any]:
    """z = T/(T − t*), z', z'', and whether z is below its limit."""
    falling = clock < duration * (1.0 - 1.0 / jnp.maximum(limit, 1.0))
    z = duration / (duration - jnp.where(falling, clock, 0.0))
    z1 = z * z / duration
    return z, z1, 2.0 * z * z1 / duration, falling


def _switched(
    function: Any,
    clock: Scalar,
    falling: Any,
    value: Scalar,
    rate: Scalar,
    curve: Scalar,
) -> Bound:
    def live(x: Scalar) -> Scalar:
        return jnp.where(falling, x, 0.0)

    return Bound(
        live(value) + function.final_bound,
        live(rate),
        live(curve),
        clock >= function.settling_time,
    )


def unbounded(clock: Scalar) -> Bound:
    """The funnel of a controller that has none: infinitely wide, never settled."""
    zero = jnp.zeros_like(clock)
    return Bound(zero + jnp.inf, zero, zero, clock < zero)
