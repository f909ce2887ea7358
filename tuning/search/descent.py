"""Gradient descent through the rollout, over an ensemble.

The exact gradient of a long run is a poor guide: where the loop oscillates it grows by
orders of magnitude with the horizon and changes within a few percent of the gains
(`jaxglider check-gradients` shows it). Three things make it useful: the gradient
forgets what was long ago (`rollout.evaluate`); each lane of the ensemble has its own
copy of the gains, scattered by a few percent; and its gradient is clipped to norm one
before the lanes are combined. A gradient takes a few members in turn, which costs less
and leads as far; the step is judged by all of them, at the gains themselves.

A step that makes the objective much worse, or not finite, is refused: back to the gains
with the best objective so far, with half the step, which then grows again by a tenth
with every step that is taken. What is returned is another matter:
the gains that are best on members the descent does not see. The steps shrink along half
a cosine. Several descents from scattered starts can run side by side.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jax import lax

from jaxglider.core.batching import map_members
from jaxglider.core.containers import Series
from jaxglider.core.differentiation import value_and_gradient
from tuning.problem.lanes import (
    FAILED,
    Loss,
    as_lanes,
    member_count,
    member_losses,
    saturate_cost,
)
from tuning.problem.objective import UNIT, Aggregate
from tuning.search.settings import DescentSettings, State, Step, make_optimiser


class Descent:
    """Descents on one ensemble: compiled once, stepped as often as wanted."""

    def __init__(
        self,
        loss: Loss,
        training: Any,
        validation: Any,
        settings: DescentSettings,
        aggregate: Aggregate | None = None,
        *,
        guide: Loss | None = None,
        unit: float = UNIT,
        devices: Sequence[jax.Device] | None = None,
    ) -> None:
        """Prepare.

        Args:
            loss: objective of free numbers and one member; pure.
            training: members to descend on, one leading axis.
            validation: members to choose by.
            settings: how to descend.
            aggregate: how members' objectives become one; the mean by default.
            guide: what is differentiated instead of `loss`; of the same values.
            unit: what a run like the start costs: the scale of poor and failed ones.
            devices: to spread the members over.
        """
        self.settings = settings
        self._loss, self._guide = loss, guide or loss
        self._aggregate = aggregate or Aggregate()
        self._unit, self._devices = unit, devices
        self._members = training, validation
        self._optimiser = make_optimiser(settings.optimiser)
        # The costly part is one program, for the start and for every step.
        self._look = jax.jit(self._looked)
        self._try = jax.jit(self._tried)
        self._settle = jax.jit(self._settled)

    def start(self, free: Series) -> State:
        """The state before the first step; further starts are scattered around it."""
        settings = self.settings
        offsets = settings.start_spread * jr.normal(
            jr.fold_in(jr.key(settings.seed), 2**31),
            (settings.starts, free.shape[0]),
            free.dtype,
        )
        return self._started(free + offsets.at[0].set(0.0))

    def advance(self, state: State) -> tuple[State, Step]:
        """One step of every descent."""
        tried, optimiser, rate = self._try(state)
        loss, slope, validation, usable = self._look_at(tried, state.number + 1)
        state, refused = self._settle(
            state, tried, optimiser, loss, slope, validation, usable
        )
        j = state.leader()
        validation = np.asarray(validation)
        step = Step(
            int(state.number),
            float(loss[j]),
            float(validation[j]),
            tried[j],
            bool(refused[j]),
            bool(validation[j] == np.asarray(state.chosen_loss)[j]),
            float(rate[j]),
        )
        return state, step

    def run(self, state: State) -> Iterator[tuple[State, Step]]:
        """Step until the steps are used up or every descent is on a plateau, or blind.

        Raises:
            FloatingPointError: the objective is not finite at any of the starts.
        """
        if not np.any(np.asarray(state.best_loss) < FAILED * self._unit):
            raise FloatingPointError(
                "the objective is not finite at the starting gains, for no member; "
                "start from gains that complete the run (--gains), or scatter several "
                "starts around these (--starts)."
            )
        settings = self.settings
        while (
            int(state.number) < settings.steps
            and int(np.min(np.asarray(state.since))) < settings.patience
            and not self.is_blind(state)
        ):
            state, step = self.advance(state)
            yield state, step

    def is_blind(self, state: State) -> bool:
        """Whether no descent had a finite gradient while every member had its turn."""
        return int(np.min(np.asarray(state.blind))) >= self.deals

    @property
    def deals(self) -> int:
        """Steps in which every member has its turn in the gradient."""
        count = member_count(self._members[0])
        return count // self.settings.batch_of(count, self._aggregate)

    def _started(self, free: jax.Array) -> State:
        number = jnp.asarray(0, jnp.int32)
        loss, slope, validation, usable = self._look_at(free, number)
        return State(
            number,
            free,
            slope,
            loss,
            jax.vmap(self._optimiser.init)(free),
            jnp.ones_like(loss),
            free,
            slope,
            loss,
            free,
            validation,
            jnp.zeros(free.shape[0], jnp.int32),
            jnp.where(usable, 0, 1).astype(jnp.int32),
        )

    def _look_at(
        self, free: jax.Array, number: jax.Array
    ) -> tuple[Series, jax.Array, Series, jax.Array]:
        """By way of the host: what lies on several devices would compile anew."""
        return self._look(*jax.device_get((free, number)), self._members)

    def _looked(
        self, free: jax.Array, number: jax.Array, members: tuple[Any, Any]
    ) -> tuple[Series, jax.Array, Series, jax.Array]:
        """Objective on all training members, gradient, objective on the others.

        And whether any lane's gradient is finite.
        """
        slope, usable = self._gradients(free, number, members[0])
        count = member_count(members[0])
        both = jax.tree.map(lambda *x: jnp.concatenate(x), *members)
        values = member_losses(self._loss, free, both, self._unit, self._devices)
        loss, validation = (
            jax.vmap(self._aggregate)(part)[0]
            for part in (values[:, :count], values[:, count:])
        )
        return loss, slope, validation, usable

    def _tried(self, state: State) -> tuple[jax.Array, Any, Series]:
        """Where the next step leads, the optimiser there, and the learning rate."""
        settings = self.settings
        turn = jnp.pi * state.number / settings.steps
        rate = settings.learning_rate * state.shrink * 0.5 * (1.0 + jnp.cos(turn))
        update, optimiser = jax.vmap(self._optimiser.update)(
            state.slope, state.optimiser, state.free
        )
        return state.free + rate[:, None] * update, optimiser, rate

    def _settled(
        self,
        state: State,
        tried: jax.Array,
        optimiser: Any,
        loss: Series,
        slope: jax.Array,
        validation: Series,
        usable: jax.Array,
    ) -> tuple[State, jax.Array]:
        """The state after a step, and which steps were refused."""
        settings = self.settings
        refused = ~(loss <= settings.worse * state.best_loss)
        better = ~refused & (loss < state.best_loss)
        chosen = ~refused & (validation < state.chosen_loss)
        target = state.chosen_loss * (1.0 - settings.progress)
        progress = ~refused & (validation < target)

        def either(flags: jax.Array, yes: Any, no: Any) -> Any:
            def pick(a: jax.Array, b: jax.Array) -> jax.Array:
                return jnp.where(flags.reshape(-1, *(1,) * (a.ndim - 1)), a, b)

            return jax.tree.map(pick, yes, no)

        fresh = jax.vmap(self._optimiser.init)(state.best_free)
        following = State(
            state.number + 1,
            either(refused, state.best_free, tried),
            either(refused, state.best_slope, slope),
            either(refused, state.best_loss, loss),
            either(refused, fresh, optimiser),
            jnp.minimum(jnp.where(refused, 0.5, 1.1) * state.shrink, 1.0),
            either(better, tried, state.best_free),
            either(better, slope, state.best_slope),
            either(better, loss, state.best_loss),
            either(chosen, tried, state.chosen),
            either(chosen, validation, state.chosen_loss),
            jnp.where(progress, 0, state.since + 1),
            jnp.where(usable | refused, 0, state.blind + 1),
        )
        return following, refused

    def _gradients(
        self, free: jax.Array, number: jax.Array, members: Any
    ) -> tuple[jax.Array, jax.Array]:
        """Clipped gradient of each row on some members, over scattered copies.

        And whether it is of any lane at all.
        """
        members = self._batch(number, members)
        count = member_count(members)
        lanes = count * -(-self.settings.copies // count)
        key = jr.fold_in(jr.key(self.settings.seed), number)
        copies = jax.vmap(lambda x: scattered(x, key, lanes, self.settings.spread))(
            free
        )
        slope_of = value_and_gradient(self._guide, members=free.shape[0] * lanes)
        values, slopes = map_members(
            lambda lane: slope_of(*lane),
            as_lanes(copies, members),
            devices=self._devices,
        )
        values = values.reshape(-1, lanes)
        norm = jnp.linalg.norm(slopes, axis=1, keepdims=True)
        clipped = jnp.where(norm > 1.0, slopes / norm, slopes)
        usable = jnp.isfinite(norm) & jnp.isfinite(values.reshape(-1, 1))
        clipped = jnp.where(usable, clipped, 0.0).reshape(-1, lanes, free.shape[1])
        _, weights = jax.vmap(self._aggregate)(saturate_cost(values, self._unit))
        slope = jnp.sum(weights[:, :, None] * clipped, axis=1)
        return slope, jnp.any(usable.reshape(-1, lanes), axis=1)

    def _batch(self, number: jax.Array, members: Any) -> Any:
        """The members of a step: the ensemble is dealt out anew once all had a turn."""
        count = member_count(members)
        batch = self.settings.batch_of(count, self._aggregate)
        if batch == count:
            return members
        key = jr.fold_in(jr.key(self.settings.seed), 2**30 + number // self.deals)
        order = jr.permutation(key, count)
        chosen = lax.dynamic_slice(order, (number % self.deals * batch,), (batch,))
        return jax.tree.map(lambda x: x[chosen], members)


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
