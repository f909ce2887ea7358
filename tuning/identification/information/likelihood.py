"""Profile likelihood: intervals of the numbers that a record tells worst.

A number is held at one value after the other while all others of its stage are fitted
again; its 95 % interval ends where twice the loss has risen by 3.84 (Wilks 1938). Where
the model bends, this interval is not that of the Fisher information, a straight line's.
Source: Raue et al., Bioinformatics 25 (2009) 1923-1929.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from tuning.identification.information.least_squares import (
    Rows,
    Solution,
    loss_of,
    remembered,
    search,
)

RISE = 3.841459
"""Rise of twice the loss at the ends of a 95 % interval."""
FARTHEST = 4.0
"""Distance from the fitted value [prior deviations] beyond which nobody looks."""
_TRIES = 3


class Number(Protocol):
    """A free number of a fit."""

    @property
    def name(self) -> str:
        """Name of the number."""

    def value(self, x: Any) -> Any:
        """The number from its coordinate."""


class Model(Protocol):
    """Predicted rows and their Jacobian at some coordinates."""

    def __call__(self, x: np.ndarray) -> tuple[Rows, Rows]:
        """Rows and Jacobian at x."""

    def changed(self, change: Callable[[Any], Any]) -> "Model":
        """The same of a flight with other inputs."""


@dataclasses.dataclass(frozen=True)
class SearchedStage:
    """A stage that has been fitted, with what it takes to fit it again.

    Attributes:
        numbers: free numbers.
        model: predicted rows and their Jacobian at some coordinates.
        measured: measured rows by channel.
        solution: solution of the stage.
    """

    numbers: tuple[Number, ...]
    model: Model
    measured: Rows
    solution: Solution


def profiles(
    stages: Sequence[SearchedStage], count: int
) -> dict[str, tuple[float, float]]:
    """Ends of the profile's 95 % interval by number, of the numbers told worst.

    An end that is not found within `FARTHEST` is NaN.

    Args:
        stages: stages of the fit.
        count: number of numbers to look at.
    """
    spreads = [
        (float(stage.solution.covariance[k, k]), n, k)
        for n, stage in enumerate(stages)
        for k in range(len(stage.numbers))
    ]
    found = {}
    for _, n, k in sorted(spreads, reverse=True)[:count]:
        stage, number = stages[n], stages[n].numbers[k]
        # A number that keeps its negative sign falls as its coordinate rises.
        rises = 1.0 if number.value(1.0) > number.value(-1.0) else -1.0
        least = _loss(stage, stage.solution.x)
        low, high = (_end(stage, k, side, least) for side in (-rises, rises))
        found[number.name] = (float(number.value(low)), float(number.value(high)))
    return found


def _loss(stage: SearchedStage, x: np.ndarray) -> float:
    return loss_of(stage.model, stage.measured, stage.solution.noise, x)


def _end(stage: SearchedStage, number: int, side: float, least: float) -> float:
    """The coordinate on one side at which the loss has risen by `RISE`."""
    best, covariance = stage.solution.x, stage.solution.covariance
    spread = float(np.sqrt(covariance[number, number]))
    direction = covariance[:, number] / covariance[number, number]
    reach = np.sqrt(RISE) * spread
    for _ in range(_TRIES):
        moved = best + side * reach * direction
        rise = _rise(stage, number, moved, least)
        if abs(rise - RISE) < 0.02 * RISE:
            break
        # The square root of the rise is a straight line for a straight model.
        reach *= float(np.clip(np.sqrt(RISE / max(rise, 1e-3)), 0.3, 3.0))
    return float(best[number] + side * reach) if reach <= FARTHEST else np.nan


def _rise(stage: SearchedStage, number: int, start: np.ndarray, least: float) -> float:
    """Rise of twice the loss with one coordinate held and the others fitted again."""
    held = start[number]

    def others(x: np.ndarray) -> tuple[Rows, Rows]:
        predicted, slopes = stage.model(np.insert(x, number, held))
        return predicted, {n: np.delete(s, number, axis=1) for n, s in slopes.items()}

    if len(start) == 1:
        return _loss(stage, start) - least
    result = search(
        remembered(others),
        stage.measured,
        stage.solution.noise,
        np.delete(start, number),
        8,
    )
    return float(2.0 * result.cost + held**2 - least)
