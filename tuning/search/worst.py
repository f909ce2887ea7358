"""Search for the worst member: the point of the unit cube at which a run is worst.

A budget of rollouts is spent in three parts: draws at random, gradient ascent from the
worst of them, and CMA-ES from the best found. A gradient counts as five rollouts. The
cube is the box of what is uncertain: every distribution works with it, and nothing
outside it is tried.

CMA-ES searches all numbers z, folded into the cube by u = 1 − |1 − (z mod 2)|, so that
its faces and corners, where the worst case often is, are reached and not just neared.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from tuning.search.evolution import GRADIENT_COST, cma_es, default_population

Severities = Callable[[np.ndarray], np.ndarray]
Slopes = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

STARTS = 4
"""Members from which the gradient ascends, side by side."""
_FIRST_STEP = 0.25
"""First step of the ascent, in the largest coordinate of the cube."""
_SPREAD = 0.15
"""First standard deviation of CMA-ES, in the cube."""


@dataclasses.dataclass(frozen=True)
class WorstCase:
    """The worst member that a search has found.

    Attributes:
        place: place of the member in the unit cube.
        severity: severity there.
        found_by: part of the search that found it: `random`, `gradient` or `cma`.
        rollouts: rollouts that the search took, a gradient counted as five.
        best: highest severity that each part of the search came to, by its name.
        places: places that were looked at, one row each.
        severities: severity at each of them.
    """

    place: np.ndarray
    severity: float
    found_by: str
    rollouts: int
    best: dict[str, float]
    places: np.ndarray
    severities: np.ndarray


def find_worst(
    severities: Severities,
    slopes: Slopes | None,
    dimensions: int,
    budget: int,
    seed: int = 0,
) -> WorstCase:
    """Search the unit cube for the largest severity.

    Args:
        severities: severity of each row of places; infinite for a run that failed.
        slopes: severities of `STARTS` places and their gradients, or None for a search
            without.
        dimensions: number of coordinates.
        budget: rollouts to spend, a gradient counted as five.
        seed: seed of the draws.

    Raises:
        ValueError: the budget is below the sixteen rollouts that draws need.
    """
    if budget < 4 * STARTS:
        raise ValueError(f"budget must be at least {4 * STARTS}; received {budget}.")
    search = _Search(severities)
    random = np.random.default_rng(seed)
    search.name = "random"
    drawn = random.uniform(size=(max(budget // 4, 4 * STARTS), dimensions))
    values = search.look(drawn)
    if slopes is not None:
        search.name = "gradient"
        starts = drawn[np.argsort(-values, kind="stable")[:STARTS]]
        steps = int(0.4 * budget / (STARTS * GRADIENT_COST))
        search.ascend(slopes, starts, steps)
    if dimensions > 1:
        search.name = "cma"
        search.evolve(budget, dimensions, seed)
    return search.result()


class _Search:
    """Account of a search, and of the worst it has seen."""

    def __init__(self, severities: Severities) -> None:
        self._severities = severities
        self._place: np.ndarray | None = None
        self._severity, self._found_by = -np.inf, ""
        self._rollouts = 0
        self._best: dict[str, float] = {}
        self._seen: list[tuple[np.ndarray, np.ndarray]] = []
        self.name = ""

    def look(self, places: np.ndarray) -> np.ndarray:
        """Severities of some places, seen and paid for."""
        values = np.asarray(self._severities(places), float)
        values = np.where(np.isnan(values), np.inf, values)
        self._rollouts += len(places)
        self._see(places, values)
        return values

    def ascend(self, slopes: Slopes, places: np.ndarray, steps: int) -> None:
        """Steps along the gradient, shortened where one leads down."""
        length = np.full(len(places), _FIRST_STEP)
        here, (values, slope) = places, self._slopes(slopes, places, steps)
        for step in range(1, steps):
            size = np.max(np.abs(slope), axis=1, keepdims=True)
            usable = np.isfinite(slope).all(axis=1, keepdims=True) & (size > 0.0)
            way = np.where(usable, slope / np.where(usable, size, 1.0), 0.0)
            there = np.clip(here + length[:, None] * way, 0.0, 1.0)
            found, new_slope = self._slopes(slopes, there, steps - step)
            better = found > values
            length = np.where(better, length, 0.5 * length)
            here = np.where(better[:, None], there, here)
            slope = np.where(better[:, None], new_slope, slope)
            values = np.where(better, found, values)

    def evolve(self, budget: int, dimensions: int, seed: int) -> None:
        """CMA-ES from the worst place so far, for what is left of the budget."""
        size, left = default_population(dimensions), budget - self._rollouts
        if left < size or self._place is None or not np.isfinite(self._severity):
            return

        def losses(rows: Any) -> Any:
            return -self.look(folded(np.asarray(rows)))

        # The start is known, and counts as one of the rollouts of its own account.
        search = cma_es(
            losses, self._place, left + 1, size, _SPREAD, seed, known=-self._severity
        )
        for _ in search:
            pass

    def result(self) -> WorstCase:
        """The worst seen."""
        assert self._place is not None
        return WorstCase(
            self._place,
            float(self._severity),
            self._found_by,
            self._rollouts,
            dict(self._best),
            *(np.concatenate(part) for part in zip(*self._seen, strict=True)),
        )

    def _slopes(
        self, slopes: Slopes, places: np.ndarray, steps: int
    ) -> tuple[np.ndarray, np.ndarray]:
        if steps < 1:
            nothing = np.full(len(places), -np.inf), np.zeros_like(places)
            return nothing
        values, slope = slopes(places)
        values = np.where(np.isnan(values), np.inf, np.asarray(values, float))
        self._rollouts += GRADIENT_COST * len(places)
        self._see(places, values)
        return values, np.asarray(slope, float)

    def _see(self, places: np.ndarray, values: np.ndarray) -> None:
        self._seen.append((np.array(places, float), values))
        at = int(np.argmax(values))
        known = self._best.get(self.name, -np.inf)
        self._best[self.name] = max(known, float(values[at]))
        if values[at] > self._severity:
            self._severity, self._place = float(values[at]), np.array(places[at], float)
            self._found_by = self.name


def folded(free: np.ndarray) -> np.ndarray:
    """Any numbers folded into [0, 1], so that its ends are as near as its middle."""
    return 1.0 - np.abs(1.0 - np.mod(free, 2.0))
