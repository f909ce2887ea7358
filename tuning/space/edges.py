"""Ends of the sets that gains must be in, some of which depend on other gains."""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.sets import Interval
from tuning.space.bijections import (
    MARGIN,
    Above,
    Below,
    Bijection,
    Positive,
    Within,
)


@dataclasses.dataclass(frozen=True)
class Edge:
    """End of a set.

    Attributes:
        at: the edge, or both, as a function of the partner gains; traced.
        rule: the set in words.
        holds: whether a gain is in the set, given its partners; plain numbers, exact.
        moved: sentence on a start that had to be moved, `{paths}` in it; empty for one
            with the numbers.
    """

    at: Callable[..., Any]
    rule: str
    holds: Callable[..., bool]
    moved: str = ""


def _sech(x: Scalar) -> Scalar:
    decay = jnp.exp(-x)
    return 2.0 * decay / (1.0 + decay * decay)


def _sech_number(x: float) -> float:
    decay = math.exp(-x)
    return 2.0 * decay / (1.0 + decay * decay)


def _arcsech(y: Scalar) -> Scalar:
    raised = y * (1.0 + MARGIN)
    return jnp.log((1.0 + jnp.sqrt((1.0 - raised) * (1.0 + raised))) / raised)


POSITIVE = Edge(lambda *_: 0.0, "positive", lambda x, *_: x > 0.0)
K2_GIVEN_K1 = Edge(
    lambda k1: jnp.sqrt(k1) * math.sqrt(4.0 / 3.0),
    "k1 < 3/4 k2^2",
    lambda k2, k1: 0.0 < k1 < 0.75 * k2 * k2,
)
K1_GIVEN_K2 = Edge(
    lambda k2: 0.75 * k2 * k2,
    "k1 < 3/4 k2^2",
    lambda k1, k2: 0.0 < k1 < 0.75 * k2 * k2,
)
SECH_BOUND = Edge(
    _sech,
    "positive and below sech(initial)",
    lambda bound, initial: 0.0 < bound < _sech_number(initial),
)
SECH_INITIAL = Edge(
    _arcsech,
    "positive, with sech(initial) above final_bound",
    lambda initial, bound: initial > 0.0 and 0.0 < bound < _sech_number(initial),
)
# sech(20) = 4e-9: a funnel that starts from more cannot be told from one that does not.
SECH_INITIAL_ALONE = Edge(
    lambda *_: 20.0, "positive and below 20", lambda initial, *_: 0.0 < initial < 20.0
)


@functools.cache
def of_interval(numbers: Interval) -> tuple[Bijection, Edge]:
    """The bijection of a number in an interval, whatever the others are.

    Zero is never reached, even where it belongs to the interval.

    Raises:
        ValueError: an interval that ends at one side only, and not at zero or above.
    """
    low, high = numbers.low, numbers.high
    if low == 0.0:
        numbers = dataclasses.replace(numbers, closed_low=False)
        if math.isinf(high):
            return Positive(), POSITIVE
    rule = numbers.words()

    def holds(x: float, *_: float) -> bool:
        return bool(numbers.holds(x))

    if math.isinf(high) and low > 0.0:
        return Above(), Edge(lambda *_: low, rule, holds)
    if math.isinf(high - low):
        raise ValueError(
            f"a tuned number must have two ends or start from zero or above; its set "
            f"is {rule}. Give its Interval both ends, or tune it not."
        )
    if low == 0.0:
        return Below(), Edge(lambda *_: high, rule, holds)
    return Within(), Edge(lambda *_: (low, high), rule, holds)


def observer_integral(rate_bound: float) -> Edge:
    """Lower edge of ι₂ given ι₁, for |d'| ≤ D.

    The published set is ι₂ > ι₁²/4 + 4D²/ι₁² for ι₁ ≤ 2√D and ι₂ > D beyond. With
    q = log(ι₁²/4D) the first is 2D cosh q. The set's edge jumps from 2D to D at q = 0,
    and a search cannot follow a jump: beyond it ours falls as D (1 + 1/(1 + 100 q²)),
    a little inside the set.
    """

    def at(proportional: Scalar) -> Scalar:
        q = 2.0 * jnp.log(proportional) - math.log(4.0 * rate_bound)
        rising = 2.0 * jnp.cosh(jnp.minimum(q, 0.0))
        flat = 1.0 + 1.0 / (1.0 + 100.0 * q * q)
        return rate_bound * jnp.where(q < 0.0, rising, flat)

    return Edge(
        at,
        f"in the observer set for a disturbance rate up to {rate_bound:g}",
        lambda integral, proportional: in_observer_set(
            proportional, integral, rate_bound
        ),
    )


def observer_proportional(rate_bound: float) -> Edge:
    """Lower edge of ι₁ given a fixed ι₂; NaN for ι₂ ≤ D, where no ι₁ is in the set."""

    def at(integral: Scalar) -> Scalar:
        # A millionth less, so that rounding errs towards the inside.
        c = integral / rate_bound * (1.0 - 1e-6)
        wide = jnp.maximum(c, 2.0)
        r = 2.0 / (wide + jnp.sqrt(wide - 2.0) * jnp.sqrt(wide + 2.0))
        return jnp.where(c > 1.0, 2.0 * jnp.sqrt(rate_bound * r), jnp.nan)

    return Edge(
        at,
        f"in the observer set for a disturbance rate up to {rate_bound:g}",
        lambda proportional, integral: in_observer_set(
            proportional, integral, rate_bound
        ),
    )


def in_observer_set(proportional: float, integral: float, rate_bound: float) -> bool:
    """Whether ι₁ and ι₂ of one axis are in the published set, for |d'| ≤ D.

    Args:
        proportional: ι₁.
        integral: ι₂.
        rate_bound: D [N/s or N m/s].
    """
    square, limit = proportional**2, rate_bound
    if not proportional > 0.0:
        return False
    if square > 4.0 * limit:
        return integral > limit
    return integral > square / 4.0 + 4.0 * limit * limit / square
