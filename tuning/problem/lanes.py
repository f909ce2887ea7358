"""The objective of sets of free numbers on an ensemble, as lanes of one batch."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import jax.random as jr

from jaxglider.core.batching import map_members
from jaxglider.core.containers import Scalar, Series
from tuning.problem.aggregates import AbstractAggregate

Loss = Callable[[Series, Any], Scalar]

POOR_COST, FAILED_COST = 2.5, 7.5
"""Objective from which a run counts by its logarithm, and what a failed one counts, in
units of what a run like the start costs; see `Objective.cost_scale`."""


def losses(
    loss: Loss,
    rows: jax.Array,
    members: Any,
    aggregate: AbstractAggregate,
    cost_scale: float,
    devices: Sequence[jax.Device] | None = None,
) -> Series:
    """The objective of each row of free numbers over all members; pure.

    Args:
        loss: loss of free numbers and one member.
        rows: free numbers, one row each.
        members: members on one leading axis.
        aggregate: mean, CVaR or soft worst of the members' objectives.
        cost_scale: cost of a run like the start.
        devices: devices to spread the lanes over.
    """
    values = member_losses(loss, rows, members, cost_scale, devices)
    return jax.vmap(aggregate)(values)[0]


def member_losses(
    loss: Loss,
    rows: jax.Array,
    members: Any,
    cost_scale: float,
    devices: Sequence[jax.Device] | None = None,
) -> jax.Array:
    """The objective of each row on each member, saturated where a run is lost.

    Args:
        loss: loss of free numbers and one member.
        rows: free numbers, one row each.
        members: members on one leading axis.
        cost_scale: cost of a run like the start.
        devices: devices to spread the lanes over.
    """
    count = member_count(members)
    copies = jnp.repeat(rows[:, None], count, axis=1)
    values = map_members(
        lambda lane: loss(*lane), as_lanes(copies, members), devices=devices
    )
    return saturate_cost(values.reshape(-1, count), cost_scale)


def scattered(centre: Series, key: jax.Array, copies: int, spread: float) -> jax.Array:
    """Copies of free numbers scattered around them in antithetic pairs.

    Args:
        centre: free numbers.
        key: random key.
        copies: number of copies; with an odd number one stays at the centre.
        spread: standard deviation of each free number.

    Returns:
        One row for each copy; their mean is the centre.
    """
    offset = spread * jr.normal(key, (copies // 2, centre.shape[0]), centre.dtype)
    rest = jnp.zeros((copies % 2, centre.shape[0]), centre.dtype)
    return centre + jnp.concatenate([offset, -offset, rest])


def as_lanes(copies: jax.Array, members: Any) -> tuple[jax.Array, Any]:
    """Every row's copies beside the members, as one axis of lanes.

    Args:
        copies: free numbers; rows, then copies of each, a multiple of the members.
        members: one leading axis.
    """
    times = copies.shape[1] // member_count(members)

    def spread(x: jax.Array) -> jax.Array:
        each = jnp.repeat(x, times, axis=0)
        return jnp.tile(each, (copies.shape[0], *(1,) * (x.ndim - 1)))

    return copies.reshape(-1, copies.shape[2]), jax.tree.map(spread, members)


def saturate_cost(values: jax.Array, cost_scale: float) -> jax.Array:
    """The objectives as they count: J, above a poor one's J₀ only J₀ (1 + log(J/J₀)).

    At most what a failed run counts, 3 J₀. A run that is lost may come to thousands, or
    to nothing finite: one must not drown the others, but the less lost of two must
    still count less.
    """
    poor, failed = POOR_COST * cost_scale, FAILED_COST * cost_scale
    beyond = poor * (1.0 + jnp.log(jnp.maximum(values, poor) / poor))
    value = jnp.minimum(jnp.where(values > poor, beyond, values), failed)
    return jnp.where(jnp.isfinite(values), value, failed)


def member_count(members: Any) -> int:
    """Number of members of an ensemble."""
    return int(jax.tree.leaves(members)[0].shape[0])
