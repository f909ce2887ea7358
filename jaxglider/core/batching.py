"""Many closed loops at once: sampled, batched in blocks, spread over devices.

Member i depends on the seed and i alone, whatever the batch it runs in, so that it can
be run again by itself.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jax import lax
from jax.sharding import Mesh, PartitionSpec

Result = TypeVar("Result")

BLOCK = 64
"""Lanes per block on a CPU: they fill the vector units and fit the first cache."""
WIDE_BLOCK = 2**14
"""Members in a block on an accelerator: enough to keep it busy, and their seas fit its
memory."""


def member_keys(seed: int, members: int, first: int = 0) -> jax.Array:
    """Keys of members `first` to `first + members`, one each.

    Args:
        seed: seed of the whole ensemble.
        members: number of members.
        first: number of the first one.

    Raises:
        ValueError: `members` is below one.
    """
    if members < 1:
        raise ValueError(f"members must be at least 1; received {members}.")
    root = jr.key(seed)
    return jax.vmap(lambda i: jr.fold_in(root, i))(jnp.arange(first, first + members))


def map_members(
    function: Callable[[Any], Result],
    members: Any,
    *,
    block: int | None = None,
    devices: Sequence[jax.Device] | None = None,
) -> Result:
    """Apply a function of one member to all members.

    Lanes are grouped into blocks that run one after the other on a device; with several
    devices each takes an equal share. The members are padded with copies of the last
    one where they do not divide evenly, and the padding is dropped from the result.

    Args:
        function: pure function of one member.
        members: pytree of arrays with one leading axis.
        block: lanes per block; what suits the backend by default.
        devices: devices to spread the members over; None for no spreading.

    Returns:
        The results with one leading axis, in the order of the members.

    Raises:
        ValueError: the leading axes differ, or `block` is below one.
    """
    sizes = {jnp.shape(leaf)[:1] for leaf in jax.tree.leaves(members)}
    if len(sizes) != 1 or () in sizes:
        raise ValueError(
            "members must be arrays with one leading axis of the same length; "
            f"received leading axes {sorted(sizes)}."
        )
    if block is None:
        platform = devices[0].platform if devices else jax.default_backend()
        block = BLOCK if platform == "cpu" else WIDE_BLOCK
    if block < 1:
        raise ValueError(f"block must be at least 1; received {block}.")
    count = int(next(iter(sizes))[0])
    if count < 1:
        raise ValueError("members must be at least one; received none.")
    shares = 1 if devices is None else len(devices)
    # As many blocks as it takes, of one size: 65 members are 2 of 33, not 64 and one.
    blocks = -(-count // (shares * block))
    lanes = -(-count // (shares * blocks))
    padded = shares * lanes * blocks
    filled = jax.tree.map(lambda x: _pad(x, padded), members)

    def share(part: Any) -> Result:
        blocks = jax.tree.map(lambda x: x.reshape(-1, lanes, *x.shape[1:]), part)
        done = lax.map(jax.vmap(function), blocks)
        return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), done)

    if devices is None or shares == 1:
        result = share(filled)
    else:
        mesh = Mesh(np.asarray(devices), ("members",))
        spec = PartitionSpec("members")
        result = jax.shard_map(
            share, mesh=mesh, in_specs=spec, out_specs=spec, check_vma=False
        )(filled)
    return jax.tree.map(lambda x: x[:count], result)


def _pad(x: jax.Array, length: int) -> jax.Array:
    missing = length - x.shape[0]
    if missing == 0:
        return x
    return jnp.concatenate([x, jnp.broadcast_to(x[-1:], (missing, *x.shape[1:]))])
