"""Gradient descent through the rollout, over an ensemble.

The exact gradient at one point is a poor guide on long horizons: where the loop
oscillates, its phase at each change of the reference decides the error, and the
derivative of that is large and of either sign. `jaxglider check-gradients` shows its
norm change by orders of magnitude within a few percent of tuned gains. So each lane of
the ensemble has its own copy of the gains, scattered by a few percent, and its gradient
is clipped to norm one before the lanes are combined.

A step that makes the objective much worse, or not finite, is refused: back to the gains
with the best objective so far, with half the step. What is returned is another matter:
the gains that are best on members the descent does not see.
"""

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import optax

from jaxglider._types import Scalar, Series
from jaxglider.ensemble import map_members
from tuning.objective import Aggregate, scattered

Loss = Callable[[Series, Any], Scalar]

OPTIMISERS: dict[str, Callable[..., optax.GradientTransformation]] = {
    name: getattr(optax, name)
    for name in ("adam", "amsgrad", "nadam", "rmsprop", "sgd", "lion")
}


@dataclasses.dataclass(frozen=True)
class Settings:
    """How to descend.

    Attributes:
        steps: number of gradient steps.
        learning_rate: of the optimiser, in free numbers (the logarithm of a gain).
        optimiser: one of `OPTIMISERS`.
        copies: fewest lanes of a gradient; fewer members are used more than once.
        spread: standard deviation of the copies, in free numbers.
        worse: a step to more than this times the best objective is refused.
        patience: stop after this many steps without progress on the validation set.
        progress: what counts as progress, relative.
        seed: of the copies.

    Raises:
        ValueError: a number outside its range, or an unknown optimiser.
    """

    steps: int = 80
    learning_rate: float = 0.1
    optimiser: str = "adam"
    copies: int = 8
    spread: float = 0.05
    worse: float = 1.25
    patience: int = 40
    progress: float = 1e-3
    seed: int = 0

    def __post_init__(self) -> None:
        if self.optimiser not in OPTIMISERS:
            raise ValueError(
                f"optimizer must be one of {', '.join(OPTIMISERS)}; "
                f"received {self.optimiser!r}."
            )
        rules = {
            "steps": (self.steps >= 1, "at least 1"),
            "learning_rate": (0.0 < self.learning_rate < float("inf"), "positive"),
            "copies": (self.copies >= 1, "at least 1"),
            "spread": (0.0 <= self.spread < float("inf"), "zero or positive"),
            "worse": (self.worse > 1.0, "above 1"),
            "patience": (self.patience >= 1, "at least 1"),
            "progress": (self.progress >= 0.0, "zero or positive"),
        }
        for name, (holds, rule) in rules.items():
            if not holds:
                raise ValueError(
                    f"{name.replace('_', '-')} must be {rule}; "
                    f"received {getattr(self, name)}."
                )


class State(eqx.Module):
    """Where a descent stands: all that its next step depends on.

    Attributes:
        number: steps made.
        free: free numbers now.
        slope: gradient there.
        loss: objective there.
        optimiser: its state, the learning rate with it.
        best_free: where the objective was lowest.
        best_loss: the objective there.
        chosen: free numbers that are best on the validation set.
        chosen_loss: validation objective there.
        since: steps since the validation objective last made progress.
    """

    number: jax.Array
    free: Series
    slope: Series
    loss: Scalar
    optimiser: Any
    best_free: Series
    best_loss: Scalar
    chosen: Series
    chosen_loss: Scalar
    since: jax.Array


@dataclasses.dataclass(frozen=True)
class Step:
    """One step of a descent, as reported.

    Attributes:
        number: of the step; 0 is the start.
        loss: objective of the training members, scattered.
        validation: objective of the validation members, at the gains themselves.
        free: free numbers that were tried.
        refused: they were not taken.
        best: they are the best so far on the validation set.
        learning_rate: in force.
    """

    number: int
    loss: float
    validation: float
    free: Series
    refused: bool
    best: bool
    learning_rate: float


class Descent:
    """A descent on one ensemble: compiled once, stepped as often as wanted."""

    def __init__(
        self,
        loss: Loss,
        training: Any,
        validation: Any,
        settings: Settings,
        aggregate: Aggregate | None = None,
    ) -> None:
        """Prepare.

        Args:
            loss: objective of free numbers and one member; pure.
            training: members to descend on, one leading axis.
            validation: members to choose by.
            settings: how to descend.
            aggregate: how members' objectives become one; the mean by default.
        """
        self.settings = settings
        self._aggregate = aggregate or Aggregate()
        self._training, self._validation = training, validation
        self._loss = loss
        self._gradient = jax.jit(self._scattered_gradient)
        self._validate = jax.jit(self._mean_loss)
        self._optimiser = optax.inject_hyperparams(OPTIMISERS[settings.optimiser])(
            learning_rate=settings.learning_rate
        )

    def start(self, free: Series) -> State:
        """The state before the first step.

        Raises:
            FloatingPointError: the objective is not finite there.
        """
        loss, slope = self._gradient(free, self._key(0), self._training)
        validation = self._validate(free, self._validation)
        if not bool(jnp.isfinite(loss) & jnp.all(jnp.isfinite(slope))):
            raise FloatingPointError(
                "the objective or its gradient is not finite at the starting gains; "
                "start from gains that complete the run for every member."
            )
        zero = jnp.asarray(0, jnp.int32)
        optimiser = self._optimiser.init(free)
        return State(
            zero, free, slope, loss, optimiser, free, loss, free, validation, zero
        )

    def advance(self, state: State) -> tuple[State, Step]:
        """One step."""
        update, optimiser = self._optimiser.update(
            state.slope, state.optimiser, state.free
        )
        number = int(state.number) + 1
        rate = float(state.optimiser.hyperparams["learning_rate"])
        tried = jnp.asarray(optax.apply_updates(state.free, update))
        loss, slope = self._gradient(tried, self._key(number), self._training)
        validation = self._validate(tried, self._validation)
        fine = bool(jnp.isfinite(loss) & jnp.all(jnp.isfinite(slope)))
        if not fine or float(loss) > self.settings.worse * float(state.best_loss):
            step = Step(
                number, float(loss), float(validation), tried, True, False, rate
            )
            return self._go_back(state, number), step
        better = float(loss) < float(state.best_loss)
        chosen = float(validation) < float(state.chosen_loss)
        progress = float(validation) < float(state.chosen_loss) * (
            1.0 - self.settings.progress
        )
        following = State(
            jnp.asarray(number, jnp.int32),
            tried,
            slope,
            loss,
            optimiser,
            tried if better else state.best_free,
            loss if better else state.best_loss,
            tried if chosen else state.chosen,
            validation if chosen else state.chosen_loss,
            jnp.asarray(0, jnp.int32) if progress else state.since + 1,
        )
        step = Step(number, float(loss), float(validation), tried, False, chosen, rate)
        return following, step

    def run(self, state: State) -> Iterator[tuple[State, Step]]:
        """Step until the steps are used up or a plateau is reached."""
        settings = self.settings
        while (
            int(state.number) < settings.steps and int(state.since) < settings.patience
        ):
            state, step = self.advance(state)
            yield state, step

    def _go_back(self, state: State, number: int) -> State:
        """Back to the best objective so far, the optimiser anew with half the step."""
        free = state.best_free
        loss, slope = self._gradient(free, self._key(number), self._training)
        optimiser = self._optimiser.init(free)
        rate = 0.5 * state.optimiser.hyperparams["learning_rate"]
        optimiser.hyperparams["learning_rate"] = rate
        return dataclasses.replace(
            state,
            number=jnp.asarray(number, jnp.int32),
            free=free,
            slope=slope,
            loss=loss,
            optimiser=optimiser,
            since=state.since + 1,
        )

    def _key(self, number: int) -> jax.Array:
        return jr.fold_in(jr.key(self.settings.seed), number)

    def _scattered_gradient(
        self, free: Series, key: jax.Array, members: Any
    ) -> tuple[Scalar, Series]:
        count = jax.tree.leaves(members)[0].shape[0]
        times = -(-self.settings.copies // count)
        lanes = jax.tree.map(lambda x: jnp.repeat(x, times, axis=0), members)
        copies = scattered(free, key, count * times, self.settings.spread)
        values, slopes = map_members(
            lambda lane: jax.value_and_grad(self._loss)(*lane), (copies, lanes)
        )
        norm = jnp.linalg.norm(slopes, axis=1, keepdims=True)
        clipped = jnp.where(norm > 1.0, slopes / norm, slopes)
        value, weights = self._aggregate(values)
        return value, jnp.sum(weights[:, None] * clipped, axis=0)

    def _mean_loss(self, free: Series, members: Any) -> Scalar:
        costs = map_members(lambda member: self._loss(free, member), members)
        value, _ = self._aggregate(costs)
        return value
