"""A start for gains that cannot be descended from: the best of many scattered ones."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np

from jaxglider._types import Series
from tuning.batch import POOR, losses
from tuning.task import Task

CANDIDATES, SPREAD = 64, 1.0
"""How many, and their standard deviation in the logarithm of a gain."""


def promising_start(task: Task, seed: int) -> tuple[Series, str]:
    """Where to descend from, and what was done about it, in words.

    The gains as given, unless their objective is one of lost runs; then the best of
    some scattered around them.

    Args:
        task: what to tune.
        seed: of the scattering.
    """
    free = task.space.read(task.loop)
    run = jax.jit(
        lambda rows: losses(
            task.loss, rows, task.training, task.aggregate, jax.devices()
        )
    )
    offsets = jr.normal(jr.key(seed), (CANDIDATES, free.shape[0]), free.dtype)
    rows = free + SPREAD * offsets.at[0].set(0.0)
    given = float(run(rows[:1])[0])
    if given < POOR:
        return free, ""
    found = np.asarray(run(rows))
    best = int(np.argmin(found))
    if not found[best] < given:
        return free, (
            f"the starting gains lose the glider (objective {given:.3g}), and so do "
            f"{CANDIDATES - 1} scattered around them; descending all the same."
        )
    return jnp.asarray(rows[best]), (
        f"the starting gains lose the glider (objective {given:.3g}): descending "
        f"from the best of {CANDIDATES - 1} scattered around them "
        f"({found[best]:.3g})."
    )
