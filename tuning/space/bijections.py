"""From any real number to a number inside a set, and back.

A gain x in a set of the theory is written as a free number z without bounds:

positive           x = exp(z)
above an edge      x = edge (1 + m) + exp(z)
below an edge      x = edge (1 − m) / (1 + exp(−z)), and above zero
between two ends   x = low + (high − low) (m + (1 − 2m) / (1 + exp(−z)))

The edge may depend on another gain. So every z gives a gain inside its set, nothing is
ever clipped, and far from the edges a step in z is a ratio of gains.

Rounding has no place for a number closer to its edge than its precision, hence the
margin m: it is wide enough for single precision, and for gains written in one precision
to be read in the other. And exp(z) has no place for any z: beyond ±20 the free number
is bent smoothly so that it stays within ±30, gains between 1e-13 and 1e13.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.core.containers import Scalar, Series

MARGIN = 1e-5
"""m: share of an edge by which a gain stays clear of it."""

_KNEE, _ROOM = 20.0, 10.0

Number = float | np.ndarray


def bend(free: Series) -> Series:
    """z for |z| ≤ 20, then ±(20 + 10 tanh((|z| − 20)/10)): smooth, within ±30."""
    size = jnp.abs(free)
    tail = jnp.tanh(jnp.maximum(size - _KNEE, 0.0) / _ROOM)
    return jnp.where(size <= _KNEE, free, jnp.sign(free) * (_KNEE + _ROOM * tail))


def unbend(bent: np.ndarray) -> np.ndarray:
    """The inverse of `bend`, for numbers within ±30; plain NumPy, not to be traced."""
    size = np.abs(bent)
    tail = np.arctanh(np.maximum(size - _KNEE, 0.0) / _ROOM)
    return np.where(size <= _KNEE, bent, np.sign(bent) * (_KNEE + _ROOM * tail))


@dataclasses.dataclass(frozen=True)
class Positive:
    """x = exp(z); the edge is not used."""

    def stretch(self, bent: Series) -> Series:
        """The part that does not need the edge."""
        return jnp.exp(bent)

    def place(self, grown: Scalar, edge: Any) -> Scalar:
        """The gain, from `stretch` and the edge."""
        return grown

    def inverse(self, gain: Number, edge: Any) -> Number:
        """The bent free number of a gain; not to be traced."""
        return np.log(gain)


@dataclasses.dataclass(frozen=True)
class Above:
    """x = edge (1 + m) + exp(z)."""

    def stretch(self, bent: Series) -> Series:
        """The part that does not need the edge."""
        return jnp.exp(bent)

    def place(self, grown: Scalar, edge: Any) -> Scalar:
        """The gain, from `stretch` and the edge."""
        return edge * (1.0 + MARGIN) + grown

    def inverse(self, gain: Number, edge: Any) -> Number:
        """The bent free number of a gain; not to be traced."""
        return np.log(gain - edge * (1.0 + MARGIN))

    def has_room_for(self, gain: float, edge: Any) -> bool:
        """Whether a gain is clear of the edge."""
        return gain >= edge * (1.0 + 2.0 * MARGIN)

    def inside(self, gain: float, edge: Any, step: float) -> float:
        """The nearest gain that is clear of the edge by a share of it."""
        return edge * (1.0 + step)


@dataclasses.dataclass(frozen=True)
class Below:
    """x = edge (1 − m) / (1 + exp(−z))."""

    def stretch(self, bent: Series) -> Series:
        """The part that does not need the edge."""
        return jax.nn.sigmoid(bent)

    def place(self, grown: Scalar, edge: Any) -> Scalar:
        """The gain, from `stretch` and the edge."""
        return edge * (1.0 - MARGIN) * grown

    def inverse(self, gain: Number, edge: Any) -> Number:
        """The bent free number of a gain; not to be traced."""
        share = gain / (edge * (1.0 - MARGIN))
        return np.log(share) - np.log1p(-share)

    def has_room_for(self, gain: float, edge: Any) -> bool:
        """Whether a gain is clear of the edge, and positive."""
        return 0.0 < gain <= edge * (1.0 - 2.0 * MARGIN)

    def inside(self, gain: float, edge: Any, step: float) -> float:
        """The nearest gain that is clear of the edge by a share of it."""
        return edge * (1.0 - step)


@dataclasses.dataclass(frozen=True)
class Within:
    """x = low + (high − low) (m + (1 − 2m) / (1 + exp(−z))), of either sign.

    Both ends are the edge, and either may depend on other gains.
    """

    def stretch(self, bent: Series) -> Series:
        """The part that does not need the edges."""
        return jax.nn.sigmoid(bent)

    def place(self, grown: Scalar, edge: Any) -> Scalar:
        """The gain, from `stretch` and both edges."""
        low, high = edge
        return low + (high - low) * (MARGIN + (1.0 - 2.0 * MARGIN) * grown)

    def inverse(self, gain: Number, edge: Any) -> Number:
        """The bent free number of a gain; not to be traced."""
        low, high = edge
        width = (high - low) * (1.0 - 2.0 * MARGIN)
        share = (gain - low - MARGIN * (high - low)) / width
        return np.log(share) - np.log1p(-share)

    def has_room_for(self, gain: float, edge: Any) -> bool:
        """Whether a gain is clear of both edges."""
        low, high = edge
        room = 2.0 * MARGIN * (high - low)
        return bool(low + room <= gain <= high - room)

    def inside(self, gain: float, edge: Any, step: float) -> float:
        """The nearest gain that is clear of both edges by a share of the interval."""
        low, high = edge
        room = step * (high - low)
        return float(min(max(gain, low + room), high - room))


Bijection = Positive | Above | Below | Within
