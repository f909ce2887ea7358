"""Aggregates: one number from the costs of members, Σ wᵢ Jᵢ with Σ wᵢ = 1.

The gradient of each is Σ wᵢ ∇Jᵢ with the same weights.
"""

import dataclasses
from abc import abstractmethod
from typing import ClassVar

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar, Series, choose


class AbstractAggregate:
    """One number for an ensemble, and the weight of each member in it.

    Attributes:
        needs_all: whether a weight depends on the costs of all members, so that a
            gradient must not be taken over some of them.
    """

    needs_all: ClassVar[bool]

    @abstractmethod
    def __call__(self, costs: Series) -> tuple[Scalar, Series]:
        """The number, and the weight of each member."""


@dataclasses.dataclass(frozen=True)
class Mean(AbstractAggregate):
    """The mean: all members weigh alike."""

    needs_all: ClassVar[bool] = False

    def __call__(self, costs: Series) -> tuple[Scalar, Series]:
        """ΣJᵢ/n, and 1/n for each member."""
        return jnp.mean(costs), jnp.full_like(costs, 1.0 / costs.shape[0])


MEAN = Mean()
"""Aggregate where nothing else is asked for."""


@dataclasses.dataclass(frozen=True)
class CVaR(AbstractAggregate):
    """The mean over the worst share of the members (conditional value at risk).

    Attributes:
        share: share of the members that counts, in (0, 1].

    Raises:
        ValueError: the share is out of its range.
    """

    share: float = 0.2
    needs_all: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not 0.0 < self.share <= 1.0:
            raise ValueError(f"share must be in (0, 1]; received {self.share}.")

    def __call__(self, costs: Series) -> tuple[Scalar, Series]:
        """The mean over the worst share; the last member counted may count in part."""
        worst = self.share * costs.shape[0]
        rank = jnp.argsort(jnp.argsort(-costs)).astype(costs.dtype)
        weights = jnp.clip(worst - rank, 0.0, 1.0) / worst
        return jnp.sum(jnp.where(weights > 0.0, weights * costs, 0.0)), weights


@dataclasses.dataclass(frozen=True)
class SoftWorst(AbstractAggregate):
    """The soft maximum, log-mean-exp: weights are a softmax of the costs.

    Attributes:
        sharpness: sharpness of the softmax, per unit of cost.

    Raises:
        ValueError: the sharpness is not positive.
    """

    sharpness: float = 5.0
    needs_all: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not self.sharpness > 0.0:
            raise ValueError(f"sharpness must be positive; received {self.sharpness}.")

    def __call__(self, costs: Series) -> tuple[Scalar, Series]:
        """log(Σ exp(s Jᵢ)/n)/s, and the softmax of s Jᵢ."""
        scaled = self.sharpness * costs
        value = jax.nn.logsumexp(scaled) - jnp.log(costs.shape[0])
        return value / self.sharpness, jax.nn.softmax(scaled)


def make_aggregate(
    kind: str = "mean", share: float | None = None, sharpness: float | None = None
) -> AbstractAggregate:
    """The aggregate of a name; a number that it does not use is checked all the same.

    Args:
        kind: `mean`, `cvar` or `worst`.
        share: share of `cvar`; its default where None.
        sharpness: sharpness of `worst`; its default where None.

    Raises:
        ValueError: an unknown name, or a number out of its range.
    """
    choices: dict[str, AbstractAggregate] = {
        "mean": Mean(),
        "cvar": CVaR() if share is None else CVaR(share),
        "worst": SoftWorst() if sharpness is None else SoftWorst(sharpness),
    }
    choose("aggregate", kind, tuple(choices))
    return choices[kind]
