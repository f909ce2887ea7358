"""What tuning makes small: a weighted sum for each member, and one number for all.

Tracking, effort and chattering are each taken relative to what the starting gains give,
so weights can be read: the default counts tracking alone, and is 3 at the start. Of the
smooth penalties, `crowding` keeps the errors inside their funnels, `roll` the glider
upright, and `saturation` the command within what the actuators follow.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr

from jaxglider._types import Scalar, Series
from jaxglider.metrics import Metrics
from jaxglider.signals import Channels, each

CHANNELS = ("depth", "pitch", "heading")


@dataclasses.dataclass(frozen=True)
class Weights:
    """How much each term counts.

    Attributes:
        tracking: L2[e] over its start, each channel.
        effort: L2[U] over its start, each channel.
        chattering: L2[ΔU] over its start, each channel.
        crowding: mean of max(x − 0.8, 0)², x the error over its funnel's edge.
        roll: max(max |φ| − roll_limit, 0)² [rad²].
        roll_limit: largest roll that costs nothing [rad].
        saturation: smooth share of the command that the actuators do not follow.

    Raises:
        ValueError: a weight is negative or not finite, or all are zero.
    """

    tracking: float = 1.0
    effort: float = 0.0
    chattering: float = 0.0
    crowding: float = 0.0
    roll: float = 0.0
    roll_limit: float = 1.3
    saturation: float = 0.0

    def __post_init__(self) -> None:
        values = dataclasses.asdict(self)
        for name, value in values.items():
            if not 0.0 <= value < float("inf"):
                raise ValueError(
                    f"weight {name} must be zero or positive; received {value}."
                )
        if not any(v for name, v in values.items() if name != "roll_limit"):
            raise ValueError("all weights are zero: nothing to tune for.")


class Objective(eqx.Module):
    """The cost of one rollout.

    Attributes:
        start: metrics with the starting gains, what the terms are relative to.
        weights: how much each term counts.
    """

    start: Metrics
    weights: Weights = eqx.field(static=True, default=Weights())

    def __call__(self, metrics: Metrics) -> Scalar:
        """The weighted sum of the terms."""
        return sum(
            getattr(self.weights, name) * value
            for name, value in self.terms(metrics).items()
        )

    def terms(self, metrics: Metrics) -> dict[str, Scalar]:
        """Each term without its weight."""

        def relative(name: str) -> Scalar:
            ratios = each(
                lambda now, start: getattr(now, name) / (getattr(start, name) + 1e-12),
                metrics.channels,
                self.start.channels,
            )
            return _total(ratios)

        def plain(name: str) -> Scalar:
            return _total(
                each(lambda channel: getattr(channel, name), metrics.channels)
            )

        over = jnp.maximum(metrics.max_roll - self.weights.roll_limit, 0.0)
        return {
            "tracking": relative("rms_error"),
            "effort": relative("rms_effort"),
            "chattering": relative("chattering"),
            "crowding": plain("funnel_crowding"),
            "roll": over * over,
            "saturation": plain("saturation_excess"),
        }


def _total(channels: Channels[Any]) -> Scalar:
    return channels.depth + channels.pitch + channels.heading


@dataclasses.dataclass(frozen=True)
class Aggregate:
    """How the costs of members become one number: Σ wᵢ Jᵢ with Σ wᵢ = 1.

    `mean` weighs all alike, `cvar` the worst share alone, `worst` by a softmax of the
    costs. The gradient of each is Σ wᵢ ∇Jᵢ with the same weights (for `worst` that of
    the soft maximum, log-mean-exp, whose value is then reported).

    Attributes:
        kind: `mean`, `cvar` or `worst`.
        share: of the members that `cvar` averages, in (0, 1].
        sharpness: of the softmax, per unit of cost.

    Raises:
        ValueError: an unknown kind, or a number outside its range.
    """

    kind: str = "mean"
    share: float = 0.2
    sharpness: float = 5.0

    def __post_init__(self) -> None:
        if self.kind not in ("mean", "cvar", "worst"):
            raise ValueError(
                f"aggregate must be one of mean, cvar, worst; received {self.kind!r}."
            )
        if not 0.0 < self.share <= 1.0 or not self.sharpness > 0.0:
            raise ValueError(
                "share must be in (0, 1] and sharpness positive; "
                f"received {self.share} and {self.sharpness}."
            )

    def __call__(self, costs: Series) -> tuple[Scalar, Series]:
        """The number, and the weight of each member."""
        count = costs.shape[0]
        if self.kind == "mean":
            return jnp.mean(costs), jnp.full_like(costs, 1.0 / count)
        if self.kind == "worst":
            scaled = self.sharpness * costs
            weights = jax.nn.softmax(scaled)
            value = (jax.nn.logsumexp(scaled) - jnp.log(count)) / self.sharpness
            return value, weights
        # Rank from the worst; the last one counted may count in part.
        rank = jnp.argsort(jnp.argsort(-costs)).astype(costs.dtype)
        weights = jnp.clip(self.share * count - rank, 0.0, 1.0) / (self.share * count)
        return jnp.sum(jnp.where(weights > 0.0, weights * costs, 0.0)), weights


def scattered(centre: Series, key: jax.Array, copies: int, spread: float) -> jax.Array:
    """Copies of free numbers scattered around them in antithetic pairs.

    Args:
        centre: free numbers.
        key: random key.
        copies: how many; with an odd number one stays at the centre.
        spread: standard deviation of each free number.

    Returns:
        One row for each copy; their mean is the centre.
    """
    offset = spread * jr.normal(key, (copies // 2, centre.shape[0]), centre.dtype)
    rest = jnp.zeros((copies % 2, centre.shape[0]), centre.dtype)
    return centre + jnp.concatenate([offset, -offset, rest])
