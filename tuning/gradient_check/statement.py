"""One line on what the gradient at some gains is worth, over the run as it is flown.

Reverse mode against central differences along a few directions, the gradient's own
first: D(h) = (J(x + h d) − J(x − h d))/2h. Of the steps h the one that agrees best
counts, since small ones are rounding and large ones curvature; of the directions the
one that agrees worst.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

STEPS = (1e-5, 1e-4, 1e-3)
"""Steps that are tried, in the scale of the free numbers."""
AGREES = 0.05
"""Largest relative difference of a derivative that is called right."""
RANDOM = 2
"""Directions beside the gradient's own."""


@dataclasses.dataclass(frozen=True)
class GradientStatement:
    """The worth of the gradient at some gains.

    Attributes:
        seconds: length of the run [s].
        finite: whether every component of it is.
        difference: largest relative difference from central differences; None where
            the gradient, or J on either side of the gains, is not finite.
        steps: steps tried, in the scale of the free numbers.
    """

    seconds: float
    finite: bool
    difference: float | None
    steps: tuple[float, ...]

    @property
    def of_use(self) -> bool:
        """Whether it is finite and agrees with differences."""
        return self.difference is not None and self.difference <= AGREES

    def text(self) -> str:
        """The statement in a line."""
        run = f"gradient at the gains over the whole run of {self.seconds:g} s"
        if not self.finite:
            return f"{run}: not finite, and of no use to go on from here."
        if self.difference is None:
            return f"{run}: finite, but the objective beside the gains is not."
        verdict = "right" if self.of_use else "not what differences say: of no use here"
        return (
            f"{run}: finite, within {self.difference:.2g} of central differences at "
            f"steps of {', '.join(f'{h:g}' for h in self.steps)}: {verdict}."
        )

    def to_dict(self) -> dict[str, Any]:
        """The statement as plain values, for JSON and TOML; None is left out."""
        values = {
            "finite": self.finite,
            "of_use": self.of_use,
            "largest_relative_difference": self.difference,
            "steps": list(self.steps),
            "seconds": self.seconds,
        }
        return {key: value for key, value in values.items() if value is not None}


def gradient_statement(
    value_and_gradient: Callable[[np.ndarray], tuple[Any, Any]],
    losses: Callable[[np.ndarray], Any],
    free: Any,
    seconds: float,
    steps: Sequence[float] = STEPS,
) -> GradientStatement:
    """Check the gradient at one point along a few directions.

    Args:
        value_and_gradient: J and its exact gradient at free numbers.
        losses: J of each row of free numbers; called once.
        free: the free numbers.
        seconds: length of the run [s].
        steps: lengths of the differences.
    """
    centre = np.asarray(free)
    gradient = np.asarray(value_and_gradient(centre)[1], np.float64)
    size = float(np.linalg.norm(gradient))
    tried = tuple(float(h) for h in steps)
    if not np.isfinite(size):
        return GradientStatement(seconds, False, None, tried)
    directions = np.random.default_rng(0).standard_normal((RANDOM, centre.size))
    if size > 0.0:
        directions = np.concatenate([gradient[None], directions])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    moves = np.asarray(tried)[:, None, None] * directions
    points = np.concatenate([centre + moves, centre - moves])
    rows = points.reshape(-1, centre.size).astype(centre.dtype)
    values = np.asarray(losses(rows), np.float64).reshape(2, len(tried), -1)
    slopes = (values[0] - values[1]) / (2.0 * np.asarray(tried)[:, None])
    if not np.isfinite(slopes).all():
        return GradientStatement(seconds, True, None, tried)
    expected = directions @ gradient
    # A direction across the gradient has no slope of its own to be relative to.
    least = size / np.sqrt(centre.size)
    scale = np.maximum(np.maximum(np.abs(slopes), np.abs(expected)), least)
    apart = np.abs(slopes - expected) / np.where(scale > 0.0, scale, 1.0)
    return GradientStatement(seconds, True, float(apart.min(axis=0).max()), tried)
