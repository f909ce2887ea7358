"""Finite-time performance functions: how wide the funnel is, t* after its restart.

A performance function P(t*) is positive, falls strictly until the settling time T, and
is its final bound P_∞ from then on. All forms here are built on z = T/(T − t*), which
runs from 1 to ∞, and carry their two derivatives along by the chain rule.

Source: Yang and Mahmoudian, Eqs. for the proposed and the original function, after Liu,
Liu and Jing 2018. Near T each form is below rounding while its factors overflow; past
an exponent of _EXPONENT_LIMIT it is replaced by P_∞, so value and gradient stay finite.
"""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import (
    Container,
    Flag,
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
        settled: flag, t* is past the settling time.
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
        a = 1.0 / jnp.cosh(self.initial)
        z, falling = _stretched_time(clock, self.settling_time, _EXPONENT_LIMIT / a)
        return _settling(self, clock, falling, _sech(a * z))


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
        a = self.initial
        z, falling = _stretched_time(clock, self.settling_time, _EXPONENT_LIMIT / a)
        return _settling(self, clock, falling, 0.5 * _sech(a * z))


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
        duration = self.settling_time
        z, falling = _stretched_time(clock, duration, _EXPONENT_LIMIT)
        # t*/T = 1 − 1/z.
        height = self.initial - (1.0 - 1.0 / z.value)
        decay = jnp.exp(1.0 - z.value)
        curve = _Curve(
            value=decay * height,
            rate=decay * (-1.0 / duration - height * z.rate),
            acceleration=decay
            * (2.0 * z.rate / duration + height * (z.rate * z.rate - z.acceleration)),
        )
        return _settling(self, clock, falling, curve)


class _Curve(eqx.Module):
    """A function of t* at one instant, with its two derivatives in t* [1/s, 1/s²]."""

    value: Scalar
    rate: Scalar
    acceleration: Scalar

    def __rmul__(self, factor: Scalar | float) -> "_Curve":
        return jax.tree.map(lambda x: factor * x, self)


def _stretched_time(
    clock: Scalar, duration: Scalar, limit: Scalar | float
) -> tuple[_Curve, Flag]:
    """z = T/(T − t*), and whether it is below its limit; past that, z of t* = 0."""
    falling = clock < duration * (1.0 - 1.0 / jnp.maximum(limit, 1.0))
    z = duration / (duration - jnp.where(falling, clock, 0.0))
    z1 = z * z / duration
    z2 = 2.0 * z * z1 / duration
    return _Curve(value=z, rate=z1, acceleration=z2), falling


def _sech(y: _Curve) -> _Curve:
    """sech y: (sech y)' = −sech y tanh y y', and so on.

    The second derivative is sech y ((tanh² y − sech² y) y'² − tanh y y'').
    """
    decay = jnp.exp(-y.value)
    sech = 2.0 * decay / (1.0 + decay * decay)
    tanh = (1.0 - decay * decay) / (1.0 + decay * decay)
    return _Curve(
        value=sech,
        rate=-sech * tanh * y.rate,
        acceleration=sech
        * ((tanh * tanh - sech * sech) * y.rate * y.rate - tanh * y.acceleration),
    )


def _settling(
    function: SechFunction | HalfSechFunction | ExponentialFunction,
    clock: Scalar,
    falling: Flag,
    curve: _Curve,
) -> Bound:
    """P = curve + P_∞ while z is below its limit, else P_∞."""
    live = jax.tree.map(lambda x: jnp.where(falling, x, 0.0), curve)
    return Bound(
        value=live.value + function.final_bound,
        rate=live.rate,
        acceleration=live.acceleration,
        settled=clock >= function.settling_time,
    )


def unbounded(clock: Scalar) -> Bound:
    """The funnel of a controller that has none: infinitely wide, never settled."""
    zero = jnp.zeros_like(clock)
    return Bound(
        value=zero + jnp.inf, rate=zero, acceleration=zero, settled=clock < zero
    )
