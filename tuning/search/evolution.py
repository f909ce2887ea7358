"""Black-box baselines: the same free numbers, the same budget, no gradient.

The budget is counted in rollout-equivalents: a loss costs as many rollouts as it has
members, and a gradient of it is counted as five of them. So a comparison with descent
does not depend on how many rollouts a machine runs at a time.

A loss that is not finite ranks behind every other and never ends a search. Both
searches draw from a generator of their own, so that the same seed gives the same
search whatever else runs in the process.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxglider.core.containers import Series

Losses = Callable[[Float[Array, "k n"]], Float[Array, " k"]]

GRADIENT_COST = 5
"""Rollouts that one gradient of one member is counted as."""


@dataclasses.dataclass(frozen=True)
class Generation:
    """One generation of a search; fields as in a step of a descent where they apply.

    Attributes:
        number: number of the generation; 0 is the start.
        loss: the lowest of the generation; infinite where none is finite.
        free: the free numbers it belongs to.
        refused: always false; a search keeps its best and refuses nothing.
        best: flag, it holds the best set so far.
        learning_rate: standard deviation of the draws, in the free numbers.
        rollouts: cost so far, in rollout-equivalents.
    """

    number: int
    loss: float
    free: Series
    refused: bool
    best: bool
    learning_rate: float
    rollouts: int


def random_search(
    losses: Losses,
    start: Series,
    budget: int,
    batch: int,
    spread: float,
    seed: int,
    *,
    members: int = 1,
) -> Iterator[Generation]:
    """Independent normal draws around the start, in batches until the budget is spent.

    Args:
        losses: function from a batch of rows of free numbers to their losses; always
            called with `batch` rows.
        start: free numbers to start from.
        budget: rollout-equivalents.
        batch: draws per generation.
        spread: standard deviation of each free number.
        seed: seed of the draws.
        members: rollouts that one loss takes.

    Yields:
        The start, then each generation.

    Raises:
        ValueError: a number outside its range, or a budget too small for a generation.
    """
    _check(budget, members, spread, batch=batch, least=1)
    ledger = _Ledger(losses, start, batch, members)
    yield ledger.start(spread)
    random = np.random.default_rng(seed)
    centre = np.asarray(start, np.float64)
    while ledger.affords_generation(budget):
        rows = centre + spread * random.standard_normal((batch, centre.size))
        yield ledger.generation(rows, spread)[1]


def cma_es(
    losses: Losses,
    start: Series,
    budget: int,
    population: int | None,
    spread: float,
    seed: int,
    *,
    members: int = 1,
    known: float | None = None,
) -> Iterator[Generation]:
    """The evolution strategy of Hansen with covariance matrix adaptation.

    The package `cma` with its default settings, but for these: a search
    that has converged starts again from the best so far with the first spread, until
    the budget is spent; a generation without a finite loss is drawn again, because it
    ranks nothing.

    Args:
        losses: function from a batch of rows of free numbers to their losses; always
            called with `population` rows.
        start: free numbers to start from; two or more.
        budget: rollout-equivalents.
        population: draws per generation; `default_population` if None.
        spread: first standard deviation of each free number.
        seed: seed of the draws.
        members: rollouts that one loss takes.
        known: loss of the start, where it has been evaluated already.

    Yields:
        The start, then each generation.

    Raises:
        ValueError: a number outside its range, or a budget too small for a generation.
    """
    count = int(jnp.size(start))
    size = default_population(count) if population is None else population
    if count < 2:
        raise ValueError(
            f"start must have two free numbers or more for CMA-ES; received {count}. "
            "Use random search."
        )
    _check(budget, members, spread, population=size, least=4)
    strategy = _strategy_maker(size, spread, seed)
    ledger = _Ledger(losses, start, size, members)
    yield ledger.start(spread, known)
    search = strategy(ledger.best)
    while ledger.affords_generation(budget):
        rows, sigma = np.asarray(search.ask()), float(search.sigma)
        values, generation = ledger.generation(rows, sigma)
        if math.isfinite(generation.loss):
            search.tell(list(rows), _ranked(values))
        yield generation
        if search.stop():
            search = strategy(ledger.best)


def default_population(count: int) -> int:
    """4 + ⌊3 log n⌋, the draws per generation of CMA-ES in n dimensions."""
    return 4 + math.floor(3.0 * math.log(count))


class _Ledger:
    """Account of the rollouts of a search, and of the best set it has seen."""

    def __init__(self, losses: Losses, start: Series, batch: int, members: int) -> None:
        self._losses, self._dtype = losses, jnp.asarray(start).dtype
        self._batch, self._members = batch, members
        self._number = self._rollouts = 0
        self._lowest = math.inf
        self.best = np.asarray(start, np.float64)

    def affords_generation(self, budget: int) -> bool:
        """Whether one more generation stays within a budget."""
        return self._rollouts + self._batch * self._members <= budget

    def start(self, spread: float, known: float | None = None) -> Generation:
        """The start as generation 0, charged as one loss.

        Where its loss is not known, it is repeated to a full batch, so that the losses
        are compiled for one shape.
        """
        rows = np.tile(self.best, (self._batch, 1))
        values = self._evaluate(rows) if known is None else np.array([known])
        return self._record(rows[:1], values[:1], spread)

    def generation(self, rows: Any, spread: float) -> tuple[np.ndarray, Generation]:
        """The losses of the rows, infinite where not finite, and what came of them."""
        values = self._evaluate(rows)
        return values, self._record(rows, values, spread)

    def _evaluate(self, rows: Any) -> np.ndarray:
        values = np.asarray(self._losses(jnp.asarray(rows, self._dtype)), np.float64)
        return np.where(np.isfinite(values), values, np.inf)

    def _record(self, rows: Any, values: np.ndarray, spread: float) -> Generation:
        self._rollouts += len(values) * self._members
        winner = int(np.argmin(values))
        loss = float(values[winner])
        better = loss < self._lowest
        if better:
            self._lowest, self.best = loss, np.asarray(rows[winner], np.float64)
        free = jnp.asarray(rows[winner], self._dtype)
        number, self._number = self._number, self._number + 1
        return Generation(number, loss, free, False, better, spread, self._rollouts)


def _strategy_maker(population: int, spread: float, seed: int) -> Callable[..., Any]:
    """A function that starts the strategy of `cma` at a point."""
    import cma

    random = np.random.default_rng(seed)
    options = {
        "popsize": population,
        # Not the global generator of NumPy, which cma would seed and others draw from.
        "randn": lambda *shape: random.standard_normal(shape),
        "seed": math.nan,
        "verbose": -9,
        "verb_log": 0,
        "signals_filename": "",
    }
    return lambda point: cma.CMAEvolutionStrategy(point, spread, dict(options))


def _ranked(values: np.ndarray) -> list[float]:
    """The losses with each infinite one as a finite number behind all others."""
    finite = values[np.isfinite(values)]
    worst = float(np.max(finite))
    behind = worst + max(1.0, abs(worst), worst - float(np.min(finite)))
    return [float(v) if math.isfinite(v) else behind for v in values]


def _check(
    budget: int, members: int, spread: float, *, least: int, **size: int
) -> None:
    ((name, draws),) = size.items()
    if members < 1:
        raise ValueError(f"members must be at least 1; received {members}.")
    if draws < least:
        raise ValueError(f"{name} must be at least {least}; received {draws}.")
    if not 0.0 < spread < math.inf:
        raise ValueError(f"spread must be positive and finite; received {spread}.")
    needed = (1 + draws) * members
    if budget < needed:
        raise ValueError(
            f"budget must be at least {needed}, for the start and one generation of "
            f"{draws} losses with {members} members each; received {budget}."
        )
