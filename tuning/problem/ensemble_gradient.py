"""The objective of an ensemble and its gradient, as one program.

Each lane of the ensemble has its own copy of the free numbers, scattered by a few
percent, and a gradient g longer than c, some multiple of what a run like the start
costs, counts for (c/|g|)² g. `tuning.search.descent` says why.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import jax.random as jr
from jax import lax

from jaxglider.core.batching import map_members
from jaxglider.core.containers import Series
from jaxglider.core.differentiation import value_and_gradient
from tuning.problem.aggregates import AbstractAggregate
from tuning.problem.lanes import (
    Loss,
    as_lanes,
    member_count,
    member_losses,
    saturate_cost,
    scattered,
)


@dataclasses.dataclass(frozen=True, eq=False)
class EnsembleGradient:
    """Objective on all members, and a gradient on some of them.

    Attributes:
        loss: objective of free numbers and one member; pure.
        surrogate: loss that is differentiated; of the same values.
        aggregate: mean, CVaR or soft worst of the members' objectives.
        cost_scale: cost of a run like the start, the scale of poor and failed ones.
        batch: number of members of a gradient, in turn.
        copies: fewest lanes of a gradient; fewer members are used more than once.
        spread: standard deviation of the copies, in free numbers.
        steepest: norm of a member's gradient, in units of the cost of a run like the
            start, beyond which it counts for less.
        seed: seed of the copies, and of the order in which members take their turns.
        devices: devices to spread the members over, or None.
    """

    loss: Loss
    surrogate: Loss
    aggregate: AbstractAggregate
    cost_scale: float
    batch: int
    copies: int
    spread: float
    steepest: float
    seed: int
    devices: Sequence[jax.Device] | None

    def __call__(
        self, free: jax.Array, number: jax.Array, members: tuple[Any, Any]
    ) -> tuple[Series, jax.Array, Series, jax.Array]:
        """Values at the free numbers of each row.

        Args:
            free: free numbers, one row for each descent.
            number: number of the step.
            members: members to descend on and members to choose by.

        Returns:
            Objective of the members to descend on, its gradient, objective of the
            others, and whether the gradient of any lane is finite.
        """
        slope, usable = self._gradients(free, number, members[0])
        count = member_count(members[0])
        both = jax.tree.map(lambda *x: jnp.concatenate(x), *members)
        values = member_losses(self.loss, free, both, self.cost_scale, self.devices)
        loss, validation = (
            jax.vmap(self.aggregate)(part)[0]
            for part in (values[:, :count], values[:, count:])
        )
        return loss, slope, validation, usable

    def deals(self, members: Any) -> int:
        """Steps in which every member has its turn in the gradient."""
        return member_count(members) // self.batch

    def _gradients(
        self, free: jax.Array, number: jax.Array, members: Any
    ) -> tuple[jax.Array, jax.Array]:
        """Gradient of each row on some members, over scattered copies.

        And whether it is of any lane at all.
        """
        members = self._batch(number, members)
        count = member_count(members)
        lanes = count * -(-self.copies // count)
        key = jr.fold_in(jr.key(self.seed), number)
        copies = jax.vmap(lambda x: scattered(x, key, lanes, self.spread))(free)
        slope_of = value_and_gradient(self.surrogate, members=free.shape[0] * lanes)
        values, slopes = map_members(
            lambda lane: slope_of(*lane),
            as_lanes(copies, members),
            devices=self.devices,
        )
        values = values.reshape(-1, lanes)
        norm = jnp.linalg.norm(slopes, axis=1, keepdims=True)
        limit = self.steepest * self.cost_scale
        weighed = slopes * jnp.minimum(limit / norm, 1.0) ** 2
        usable = jnp.isfinite(norm) & jnp.isfinite(values.reshape(-1, 1))
        weighed = jnp.where(usable, weighed, 0.0).reshape(-1, lanes, free.shape[1])
        _, weights = jax.vmap(self.aggregate)(saturate_cost(values, self.cost_scale))
        slope = jnp.sum(weights[:, :, None] * weighed, axis=1)
        return slope, jnp.any(usable.reshape(-1, lanes), axis=1)

    def _batch(self, number: jax.Array, members: Any) -> Any:
        """The members of a step: the ensemble is dealt out anew once all had a turn."""
        count = member_count(members)
        if self.batch == count:
            return members
        deals = self.deals(members)
        key = jr.fold_in(jr.key(self.seed), 2**30 + number // deals)
        order = jr.permutation(key, count)
        chosen = lax.dynamic_slice(order, (number % deals * self.batch,), (self.batch,))
        return jax.tree.map(lambda x: x[chosen], members)
