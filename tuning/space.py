"""Which gains are tuned, and the free numbers that stand for them.

A gain is named by its dotted path in the controller, `gains.depth.k1`. Positive gains
are tuned by their logarithm: no step can make one negative, and a step is a ratio.
"""

import dataclasses
from operator import attrgetter
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider._types import Container, Series

Controller = TypeVar("Controller", bound=Container)

FIXED_TIME_GAINS = tuple(
    f"gains.{channel}.{gain}"
    for channel in ("depth", "pitch", "heading")
    for gain in ("k1", "k2")
)
"""k₁ and k₂ of FxTPPC on the three channels."""


@dataclasses.dataclass(frozen=True)
class PositiveGains:
    """A set of positive gains of a controller as one vector of logarithms.

    Attributes:
        paths: dotted paths of the gains in the controller.
    """

    paths: tuple[str, ...] = FIXED_TIME_GAINS

    def read(self, controller: Container) -> Series:
        """The free numbers of a controller: log of each gain.

        Raises:
            ValueError: the controller has no such gain.
        """
        return jnp.log(jnp.stack(self._leaves(controller)))

    def write(self, controller: Controller, free: Series) -> Controller:
        """The controller with the gains that the free numbers stand for."""
        return eqx.tree_at(self._leaves, controller, list(jnp.exp(free)))

    def _leaves(self, controller: Container) -> list[Any]:
        try:
            return [attrgetter(path)(controller) for path in self.paths]
        except AttributeError as error:
            raise ValueError(
                f"{type(controller).__name__} lacks one of {', '.join(self.paths)} "
                f"({error}); tune a controller that has them all."
            ) from error


def perturbed(free: Series, key: jax.Array, pairs: int, spread: float) -> jax.Array:
    """Copies of the free numbers, scattered in antithetic pairs around them.

    Args:
        free: the centre.
        key: random key.
        pairs: number of pairs.
        spread: standard deviation of each free number.

    Returns:
        Array of 2 × pairs rows whose mean is the centre.
    """
    offset = spread * jax.random.normal(key, (pairs, free.shape[0]), free.dtype)
    return free + jnp.concatenate([offset, -offset])
