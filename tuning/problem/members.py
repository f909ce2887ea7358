"""The ensembles that gains are tuned on and judged by: gliders, seas, starts.

Member i of a set depends on the seed, the set and i alone. The sets have streams of
their own, so no member is in two of them, whatever the seed.
"""

from typing import Any

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np

from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.uncertainty.members import Member, Uncertainty, look_up
from jaxglider.uncertainty.sampling import MonteCarlo

TRAINING, VALIDATION, TEST, SWEEP, SENSITIVITY = range(5)


def nominal_member(loop: ClosedLoop) -> Member:
    """The loop's own glider and sea, as an ensemble of one."""
    return Member({}, jr.key_data(jr.key(0))[None])


def and_nominal(members: Member, loop: ClosedLoop) -> Member | None:
    """The members, and behind them the loop's own glider and sea; one program for all.

    None where a quantity has no nominal value, as the rate of an actuator without one.

    Args:
        members: ensemble.
        loop: closed loop.
    """
    own = {path: look_up(loop.scenario, path) for path in members.values}
    if any(value is None for value in own.values()):
        return None
    # Joined on the host, where nothing compiles.
    values = {
        path: jnp.asarray(np.append(x, own[path])) for path, x in members.values.items()
    }
    keys = np.concatenate([members.key, nominal_member(loop).key])
    return Member(values, jnp.asarray(keys))


def sample_members(
    uncertainty: Uncertainty, seed: int, kind: int, count: int
) -> Member:
    """An ensemble of independent members.

    Args:
        uncertainty: quantities that differ from member to member.
        seed: seed of all sets.
        kind: `TRAINING`, `VALIDATION`, `TEST` or `SWEEP`.
        count: number of members.

    Raises:
        ValueError: `count` is below one.
    """
    if count < 1:
        raise ValueError(f"members must be at least 1; received {count}.")
    design = MonteCarlo(seed, uncertainty.names(), kind)
    return uncertainty.sample(design, keys_of(seed, kind, jnp.arange(count)))


def keys_of(seed: int, kind: int, numbers: Any) -> jax.Array:
    """Keys for what is left to chance within the runs of these members of a set.

    Args:
        seed: seed of all sets.
        kind: number of the set.
        numbers: numbers of the members.
    """
    root = jr.fold_in(jr.key(seed), kind)
    return jax.vmap(lambda number: jr.fold_in(root, number))(jnp.asarray(numbers))
