"""A start that cannot be descended from is exchanged for a better one, and said so."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from tuning.objective import Aggregate
from tuning.rescue import CANDIDATES, promising_start


def task(loss, start):
    return SimpleNamespace(
        loss=lambda free, member: loss(free) + 0.0 * member,
        space=SimpleNamespace(read=lambda loop: jnp.asarray(start)),
        loop=None,
        training=jnp.zeros(3),
        aggregate=Aggregate(),
    )


def test_a_start_that_runs_is_kept():
    free, said = promising_start(task(lambda x: jnp.sum(x**2), [1.0, 2.0]), 0)
    np.testing.assert_array_equal(free, [1.0, 2.0])
    assert said == ""


@pytest.mark.parametrize("start", [3.0, -3.0])
def test_a_start_that_fails_gives_way_to_the_best_one_near(start):
    """Runs fail beyond 2: gains far too high and far too low are both brought back."""
    loss = lambda x: jnp.where(jnp.abs(x[0]) < 2.0, 1.0 + x[0] ** 2, jnp.nan)
    free, said = promising_start(task(loss, [start, 0.0]), 0)
    assert abs(float(free[0])) < 2.0
    assert "the starting gains lose the glider (objective 30)" in said
    assert f"the best of {CANDIDATES - 1}" in said
    assert f"({1.0 + float(free[0]) ** 2:.3g})" in said


def test_where_all_fail_it_is_said_and_the_start_kept():
    free, said = promising_start(task(lambda x: jnp.sum(x) * jnp.nan, [1.0, 2.0]), 0)
    np.testing.assert_array_equal(free, [1.0, 2.0])
    assert "and so do" in said
