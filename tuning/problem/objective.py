"""Objective of tuning: a weighted sum for each member, and one number for all.

Tracking, effort and chattering are each taken relative to what the starting gains give
on the nominal case, so weights can be read; `baseline` says what stands in where that
is nothing. Of the smooth penalties, `crowding` keeps the errors inside their funnels,
`roll` the glider upright, and `saturation` the command within what the actuators
follow.

A cost of the user's own takes the place of all this: see `load_cost`.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.signals import CHANNELS
from jaxglider.simulation.metrics import Metrics
from jaxglider.simulation.specification import Specification

DEFAULT_COST_SCALE = 7.5
"""Cost of a run that tracks like the start, with the default weights."""
Cost = Callable[[Metrics, Metrics], Scalar]


@dataclasses.dataclass(frozen=True)
class Weights:
    """Weights of the terms of the objective.

    A term of the channels takes one number for all three, or three in their order.

    Attributes:
        tracking: L2[e] over its start, each channel.
        effort: L2[U] over its start, each channel.
        chattering: L2[ΔU] over its start, each channel.
        crowding: share of the time at the edge of its funnel or beyond, smooth.
        roll: max(max |φ| − roll_limit, 0)² [rad²].
        roll_limit: largest roll that costs nothing [rad]; None for the bank limit that
            is specified, or 1.5 where none is.
        saturation: smooth share of the command that the actuators do not follow.
        energy: energy per km through the water over its start, where yos are flown.
        travel: way of the actuator over its start, each channel.

    Raises:
        ValueError: a weight is negative or not finite, or all are zero.
    """

    tracking: float | tuple[float, ...] = 1.0
    effort: float | tuple[float, ...] = 0.0
    chattering: float | tuple[float, ...] = 0.0
    crowding: float | tuple[float, ...] = 0.0
    roll: float = 0.0
    roll_limit: float | None = None
    saturation: float | tuple[float, ...] = 0.0
    energy: float = 0.0
    travel: float | tuple[float, ...] = 0.0

    def __post_init__(self) -> None:
        values = {
            field.name: by_channel(getattr(self, field.name))
            for field in dataclasses.fields(self)
            if getattr(self, field.name) is not None
        }
        for name, weights in values.items():
            if len(weights) != len(CHANNELS):
                raise ValueError(
                    f"weight {name} must be one number or three, for "
                    f"{', '.join(CHANNELS)}; received {list(weights)}."
                )
            if not all(0.0 <= value < float("inf") for value in weights):
                raise ValueError(
                    f"weight {name} must be zero or positive; "
                    f"received {getattr(self, name)}."
                )
        if not any(any(v) for name, v in values.items() if name != "roll_limit"):
            raise ValueError("all weights are zero: nothing to tune for.")

    def limited(self, specification: Specification | None) -> "Weights":
        """The same with a roll limit that is a number.

        Args:
            specification: specification of the run, or None.
        """
        if self.roll_limit is not None:
            return self
        bank = None if specification is None else specification.largest_roll
        limit = UPRIGHT if bank is None else float(bank)
        return dataclasses.replace(self, roll_limit=limit)


UPRIGHT = 1.5
"""Roll limit where no bank limit is specified [rad]."""


def by_channel(weight: float | tuple[float, ...]) -> tuple[float, ...]:
    """A weight for each channel."""
    return weight if isinstance(weight, tuple) else (weight,) * len(CHANNELS)


TERMS = {
    # term of the channels: its measure, and whether it is relative to the start
    "tracking": ("rms_error", True),
    "effort": ("rms_effort", True),
    "chattering": ("chattering", True),
    "travel": ("travel", True),
    "crowding": ("funnel_crowding", False),
    "saturation": ("saturation_excess", False),
}


class Objective(eqx.Module):
    """The cost of one rollout.

    Attributes:
        baseline: metrics of the nominal run at the start, which terms are relative to.
        weights: weights of the terms.
        cost: cost function of the user's own, taken instead; see `load_cost`.
    """

    baseline: Metrics
    weights: Weights = eqx.field(static=True, default=Weights())
    cost: Cost | None = eqx.field(static=True, default=None)

    def __call__(self, metrics: Metrics) -> Scalar:
        """The weighted sum of the terms, or the user's own cost."""
        if self.cost is not None:
            return self.cost(metrics, self.baseline)
        total = self.weights.roll * self.roll_excess(metrics)
        for name, values in self.terms(metrics).items():
            for weight, value in zip(
                by_channel(getattr(self.weights, name)), values, strict=True
            ):
                total = total + weight * value
        return total + self._flight(metrics)

    def _flight(self, metrics: Metrics) -> Scalar | float:
        """The term of a flight; nothing where it weighs nothing.

        Raises:
            ValueError: it weighs something, and no flight is measured.
        """
        weights, flight, start = self.weights, metrics.flight, self.baseline.flight
        if not weights.energy:
            return 0.0
        if flight is None or start is None:
            raise ValueError(
                "the weight energy needs a mission that flies yos, or one with a table "
                "[energy]; this one measures no flight."
            )
        used = flight.energy_per_through_water
        return weights.energy * used / (start.energy_per_through_water + 1e-12)

    def cost_scale(self) -> float:
        """Cost of a run like the start: the scale of poor and of failed ones.

        The weights of tracking together, or, where there are none, those of the next
        terms that have any. With a cost of the user's own, that of the start.

        Raises:
            ValueError: the user's cost is not positive there.
        """
        if self.cost is not None:
            try:
                value = float(self.cost(self.baseline, self.baseline))
            except TypeError as error:
                raise ValueError(f"--cost must give one number: {error}") from error
            if not 0.0 < value < float("inf"):
                raise ValueError(
                    "--cost must be positive at the start, on the nominal case, to "
                    f"tell a poor run from a good one; it gives {value:g}. Add a "
                    "constant to it."
                )
            return value
        commands = ("effort", "chattering", "travel")
        for names in (("tracking",), commands, ("crowding", "saturation")):
            total = sum(sum(by_channel(getattr(self.weights, n))) for n in names)
            if total > 0.0:
                return total
        return self.weights.energy or self.weights.roll

    def terms(self, metrics: Metrics) -> dict[str, tuple[Scalar, ...]]:
        """Each term of the channels without its weights, in their order."""
        return {name: self._channels(metrics, *how) for name, how in TERMS.items()}

    def roll_excess(self, metrics: Metrics) -> Scalar:
        """max(max |φ| − roll_limit, 0)² [rad²]."""
        limit = self.weights.limited(None).roll_limit
        over = jnp.maximum(metrics.max_roll - limit, 0.0)
        return over * over

    def _channels(
        self, metrics: Metrics, measure: str, relative: bool
    ) -> tuple[Scalar, ...]:
        def value(of: Metrics, channel: str) -> Scalar:
            return getattr(getattr(of.channels, channel), measure)

        if not relative:
            return tuple(value(metrics, c) for c in CHANNELS)
        return tuple(
            value(metrics, c) / (value(self.baseline, c) + 1e-12) for c in CHANNELS
        )
