"""Settings of a descent, its state, and its report of a step."""

import dataclasses
import difflib
import inspect
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from jaxglider.core.containers import Series, choose
from tuning.problem.aggregates import AbstractAggregate
from tuning.search.evolution import GRADIENT_COST


@dataclasses.dataclass(frozen=True)
class DescentSettings:
    """Settings of a descent.

    Attributes:
        steps: number of gradient steps.
        learning_rate: learning rate of the first step, in free numbers (the logarithm
            of a gain).
        optimiser: name of an optimiser of optax.
        batch: members of a gradient, in turn; all where not the mean is sought.
        copies: fewest lanes of a gradient; fewer members are used more than once.
        spread: standard deviation of the copies, in free numbers.
        steepest: norm of a member's gradient, in units of the cost of a run like the
            start, beyond which it counts for less.
        worse: a step to more than this times the best objective is refused.
        patience: number of steps without progress on the validation set after which the
            descent stops.
        progress: smallest relative gain that counts as progress.
        starts: number of descents side by side; all but the first from scattered gains.
        start_spread: standard deviation of the starts, in free numbers.
        seed: seed of copies and starts.

    Raises:
        ValueError: a number outside its range, or an unknown optimiser.
    """

    steps: int = 80
    learning_rate: float = 0.05
    optimiser: str = "adam"
    batch: int = 16
    copies: int = 8
    spread: float = 0.05
    steepest: float = 1.3
    worse: float = 1.2
    patience: int = 20
    progress: float = 1e-3
    starts: int = 1
    start_spread: float = 0.5
    seed: int = 0

    def __post_init__(self) -> None:
        make_optimiser(self.optimiser)
        rules = {
            "steps": (self.steps >= 1, "at least 1"),
            "learning_rate": (0.0 < self.learning_rate < float("inf"), "positive"),
            "batch": (self.batch >= 1, "at least 1"),
            "copies": (self.copies >= 1, "at least 1"),
            "spread": (0.0 <= self.spread < float("inf"), "zero or positive"),
            "steepest": (self.steepest > 0.0, "positive"),
            "worse": (self.worse > 1.0, "above 1"),
            "patience": (self.patience >= 1, "at least 1"),
            "progress": (self.progress >= 0.0, "zero or positive"),
            "starts": (self.starts >= 1, "at least 1"),
            "start_spread": (0.0 < self.start_spread < float("inf"), "positive"),
        }
        for name, (holds, rule) in rules.items():
            if not holds:
                raise ValueError(
                    f"{name.replace('_', '-')} must be {rule}; "
                    f"received {getattr(self, name)}."
                )

    def batch_of(self, members: int, aggregate: AbstractAggregate) -> int:
        """Members of a gradient: a rank or a softmax needs them all."""
        return members if aggregate.needs_all else min(self.batch, members)

    def gradient_cost(self, members: int, aggregate: AbstractAggregate) -> int:
        """Rollouts that a step counts as: its gradient, and the loss that judges it."""
        batch = self.batch_of(members, aggregate)
        lanes = batch * -(-self.copies // batch)
        return GRADIENT_COST * lanes + members


@dataclasses.dataclass(frozen=True)
class BlackBoxSettings:
    """Settings of a search without gradients.

    Attributes:
        method: name of the search, `cma` or `random`.
        population: draws per generation; that of CMA-ES where None.
        spread: standard deviation of the first draws, in free numbers.

    Raises:
        ValueError: an unknown method, or a number out of its range.
    """

    method: str = "cma"
    population: int | None = None
    spread: float = 0.5

    def __post_init__(self) -> None:
        choose("method", self.method, ("cma", "random"))
        if self.population is not None and self.population < 4:
            raise ValueError(
                f"population must be at least 4; received {self.population}."
            )
        if not 0.0 < self.spread < float("inf"):
            raise ValueError(f"spread must be positive; received {self.spread}.")


class Point(eqx.Module):
    """Free numbers of each descent with what is known there, one row each.

    Attributes:
        free: free numbers.
        slope: gradient of the objective.
        loss: objective of the training members.
    """

    free: jax.Array
    slope: jax.Array
    loss: Series


class State(eqx.Module):
    """State of the descents, one row each: all that their next step depends on.

    Attributes:
        number: number of steps made.
        current: point that the next step starts from.
        best: point where the objective was lowest.
        chosen_free: free numbers that are best on the validation set.
        chosen_loss: validation objective there.
        optimiser: state of the optimiser.
        shrink: share of the learning rate in force.
        since: number of steps since the validation objective last made progress.
        blind: number of steps in a row without a finite gradient in any lane.
    """

    number: jax.Array
    current: Point
    best: Point
    chosen_free: jax.Array
    chosen_loss: Series
    optimiser: Any
    shrink: Series
    since: jax.Array
    blind: jax.Array

    def leader(self) -> int:
        """The descent that is best on the validation set so far."""
        return int(np.argmin(np.asarray(self.chosen_loss)))


class Evaluation(eqx.Module):
    """Values at the free numbers of each descent, one row each.

    Attributes:
        loss: objective of all training members.
        slope: gradient of the surrogate loss; what is too steep counts for less.
        validation: objective of the validation members.
        usable: whether the gradient of any lane is finite.
    """

    loss: Series
    slope: jax.Array
    validation: Series
    usable: jax.Array


class Proposal(eqx.Module):
    """Next step of each descent.

    Attributes:
        free: free numbers to try, one row each.
        optimiser: state of the optimiser there.
        rate: learning rate of each descent.
    """

    free: jax.Array
    optimiser: Any
    rate: Series


@dataclasses.dataclass(frozen=True)
class Step:
    """One step, of the descent that leads after it, as reported.

    Attributes:
        number: number of the step; 0 is the start.
        loss: objective of the training members.
        validation: objective of the validation members, at the gains themselves.
        free: free numbers that were tried.
        refused: whether they were not taken.
        best: whether they are the best so far on the validation set.
        learning_rate: learning rate in force.
    """

    number: int
    loss: float
    validation: float
    free: Series
    refused: bool
    best: bool
    learning_rate: float


def make_optimiser(name: str) -> optax.GradientTransformation:
    """The optimiser of optax of this name, with a learning rate of one.

    Args:
        name: name such as `adam`, `rmsprop` or `lion`.

    Raises:
        ValueError: optax has none of this name that needs a gradient alone.
    """
    make = getattr(optax, name, None)
    if callable(make) and "learning_rate" in _parameters(make):
        try:
            optimiser = make(learning_rate=1.0)
            at = jnp.zeros(2)
            optimiser.update(at, optimiser.init(at), at)
        except TypeError:
            pass
        else:
            return optimiser
    known = [
        n
        for n in dir(optax)
        if n.islower()
        and n != name
        and "learning_rate" in _parameters(getattr(optax, n))
    ]
    near = difflib.get_close_matches(name, known, 3) or ["adam", "rmsprop", "sgd"]
    raise ValueError(
        "optimizer must be one of optax that needs nothing but a gradient and a "
        f"learning rate, as {', '.join(near)}; received {name!r}."
    )


def _parameters(thing: object) -> tuple[str, ...]:
    if not callable(thing):
        return ()
    try:
        return tuple(inspect.signature(thing).parameters)
    except (TypeError, ValueError):
        return ()
