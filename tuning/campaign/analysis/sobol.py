"""Sobol indices by the design of Saltelli and the estimators of Jansen and Saltelli.

f(A) − f(AB_j), the change when number j alone is drawn anew, tells how much of the
variance goes when all but j are known. With rows A_i, B_i of independent coordinates
and AB_j = A with column j of B,

    S_j  = mean[f(B) (f(AB_j) − f(A))] / V          (Saltelli et al. 2010, b)
    S_Tj = mean[(f(A) − f(AB_j))²] / (2 V)          (Jansen 1999)

with V the variance over A and B together, and f centred by their mean. Intervals are
percentiles over rows drawn again with replacement.
"""

import dataclasses
import functools
import warnings
from typing import Any

import numpy as np

from jaxglider.uncertainty.sampling import AbstractSampler

REPEATS = 400
"""Resamplings behind an interval."""


@dataclasses.dataclass(frozen=True)
class Saltelli(AbstractSampler):
    """Blocks of 2 + k rows: A_i, B_i, then A_i with column j of B_i for each factor j.

    Attributes:
        seed: seed of the scrambling.
        columns: number of uncertain numbers.
        bases: number of blocks.
        chance: whether what is left to chance within a run is a factor of its own,
            after the others.
    """

    seed: int
    columns: int
    bases: int
    chance: bool = False

    @property
    def factors(self) -> int:
        """k."""
        return self.columns + self.chance

    @property
    def block(self) -> int:
        """Rows to a block."""
        return 2 + self.factors

    def rows(self, first: int, count: int) -> np.ndarray:
        """Coordinates of runs `first` to `first + count`."""
        points = _points(self.seed, self.columns, self.bases)
        coordinates = np.empty((count, self.columns))
        for at in range(count):
            base, place = divmod(first + at, self.block)
            a, b = np.split(points[base], 2)
            coordinates[at] = b if place == 1 else a
            factor = place - 2
            if 0 <= factor < self.columns:
                coordinates[at, factor] = b[factor]
        return coordinates

    def key_numbers(self, first: int, count: int) -> np.ndarray:
        """Numbers of the keys of these runs: those of A and of B differ."""
        base, place = np.divmod(np.arange(first, first + count), self.block)
        anew = (place == 1) | (self.chance & (place - 2 == self.columns))
        return 2 * base + anew


@functools.lru_cache(maxsize=2)
def _points(seed: int, columns: int, bases: int) -> np.ndarray:
    """Rows of A and B side by side, of one scrambled Sobol sequence."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(2 * columns, scramble=True, seed=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return np.maximum(sequence.random(bases), 2.0**-54)


def indices(results: np.ndarray, seed: int = 0) -> dict[str, Any]:
    """First and total Sobol indices of every factor, with 95 % intervals.

    A block with a result that is not finite has no variance and is left out; how many
    is said.

    Args:
        results: results, one row a block: f(A), f(B), f(AB_1) and so on.
        seed: seed of the resampling.

    Returns:
        `first` and `total`, rows of estimate, lower and upper end; `blocks` used and
        `left_out`. None for both where nothing varies.
    """
    usable = np.all(np.isfinite(results), axis=1)
    blocks = results[usable]
    table: dict[str, Any] = {
        "blocks": len(blocks),
        "left_out": int(np.sum(~usable)),
        "first": None,
        "total": None,
    }
    if len(blocks) < 2 or np.ptp(blocks[:, :2]) == 0.0:
        return table
    rng = np.random.default_rng(seed)
    again = rng.integers(0, len(blocks), (REPEATS, len(blocks)))
    estimate = _estimate(blocks)
    resampled = np.stack([_estimate(blocks[rows]) for rows in again])
    low, high = np.nanquantile(resampled, [0.025, 0.975], axis=0)
    for row, name in enumerate(("first", "total")):
        table[name] = np.stack([estimate[row], low[row], high[row]])
    return table


def _estimate(results: np.ndarray) -> np.ndarray:
    """First and total indices, one row each."""
    centred = results - results[:, :2].mean()
    a, b, mixed = centred[:, :1], centred[:, 1:2], centred[:, 2:]
    variance = centred[:, :2].var()
    if variance == 0.0:
        return np.full((2, mixed.shape[1]), np.nan)
    first = np.mean(b * (mixed - a), axis=0)
    total = np.mean((a - mixed) ** 2, axis=0) / 2.0
    return np.stack([first, total]) / variance
