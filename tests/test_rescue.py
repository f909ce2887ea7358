"""A start that cannot be descended from is exchanged for a better one, and said so."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

import tuning.search.black_box
from tuning.problem.aggregates import Mean
from tuning.problem.lanes import FAILED_COST, losses
from tuning.problem.objective import DEFAULT_COST_SCALE
from tuning.reporting.console import SilentProgress
from tuning.search.black_box import search_black_box
from tuning.search.rescue import (
    DRAWS_PER_GENERATION,
    MOST_GENERATIONS,
    MOST_HOPELESS,
    PROMISING_COST,
    CannotStart,
    is_lost,
    promising_gains,
)
from tuning.search.settings import BlackBoxSettings, DescentSettings

MEMBERS = 3


def task(loss):
    members = jnp.zeros(MEMBERS)
    each = lambda free, member: loss(free) + 0.0 * member
    return SimpleNamespace(
        training=members,
        cost_scale=DEFAULT_COST_SCALE,
        losses_on=lambda members: (
            lambda rows: losses(each, rows, members, Mean(), DEFAULT_COST_SCALE)
        ),
    )


def island(x):
    """Runs fail beyond 2 of the origin in the first number."""
    return jnp.where(jnp.abs(x[0]) < 2.0, 1.0 + x[0] ** 2 + x[1] ** 2, jnp.nan)


@pytest.mark.parametrize(
    ("objectives", "lost"),
    [([5.7], False), ([5.9], True), ([30.0], True), ([30.0, 4.0], False)],
)
def test_a_start_is_lost_where_no_objective_is_worth_a_descent(objectives, lost):
    assert is_lost(jnp.asarray(objectives), 4.0) is lost
    assert is_lost(10.0 * jnp.asarray(objectives), 40.0) is lost


@pytest.mark.parametrize("start", [3.0, -3.0])
def test_a_start_that_fails_gives_way_to_a_better_one(start):
    """Gains far too high and far too low are both brought back."""
    told = []
    free, spent, said, tried = promising_gains(
        task(island),
        jnp.asarray([start, 4.0]),
        FAILED_COST * DEFAULT_COST_SCALE,
        0,
        told.append,
    )
    assert float(island(free)) < PROMISING_COST * DEFAULT_COST_SCALE
    assert tried == ()
    failed = FAILED_COST * DEFAULT_COST_SCALE
    assert f"members go astray with the starting gains (objective {failed:.3g})" in said
    assert f"({float(island(free)):.3g})" in said
    assert f"generation 1/{MOST_GENERATIONS}" in told[1]
    assert len(told) <= MOST_GENERATIONS
    assert spent == MEMBERS * (1 + DRAWS_PER_GENERATION * (len(told) - 1))


def test_gains_that_are_not_acceptable_do_not_end_the_search():
    """Half of the plane is not; the search begins there."""
    fit = lambda free: bool(free[0] < 0.0)
    start = jnp.asarray([3.0, 4.0])
    free, spent, _, _ = promising_gains(
        task(island), start, None, 0, lambda text: None, fit
    )
    easily = promising_gains(task(island), start, None, 0)
    assert not fit(easily.free)
    assert fit(free)
    assert spent >= easily.rollouts
    never = promising_gains(
        task(island), start, None, 0, lambda text: None, lambda free: False
    )
    assert float(island(never.free)) < PROMISING_COST * DEFAULT_COST_SCALE


def test_gains_are_looked_at_once_and_the_lost_ones_given_are_not_taken():
    start, seen = jnp.asarray([3.0, 4.0]), []

    def as_given(free):
        seen.append(tuple(map(float, free)))
        return bool(jnp.all(free == start))

    free, _, said, _ = promising_gains(
        task(island), start, None, 0, lambda text: None, as_given
    )
    assert float(island(free)) < PROMISING_COST * DEFAULT_COST_SCALE
    assert f"a search of {MOST_GENERATIONS} generations" in said
    assert len(seen) == len(set(seen)) > 1


def test_where_all_fail_it_is_said_and_the_best_three_are_told():
    free, spent, said, tried = promising_gains(
        task(lambda x: jnp.sum(x) * jnp.nan),
        jnp.asarray([1.0, 2.0]),
        FAILED_COST * DEFAULT_COST_SCALE,
        0,
    )
    np.testing.assert_array_equal(free, [1.0, 2.0])
    assert f"with {DRAWS_PER_GENERATION * MOST_HOPELESS} others around them" in said
    assert len(tried) == 3
    assert [one.loss for one in tried] == sorted(one.loss for one in tried)
    assert spent == MEMBERS * (1 + DRAWS_PER_GENERATION * MOST_HOPELESS)


@pytest.mark.parametrize("method", ["cma", "random"])
def test_a_search_without_gradients_that_loses_every_glider_says_so(
    monkeypatch, method
):
    told = []

    def explained(problem, search):
        told.append(search)
        return CannotStart(search.remark)

    monkeypatch.setattr(tuning.search.black_box, "cannot_start", explained)
    problem = task(lambda x: jnp.sum(x) * jnp.nan)
    problem.validation, problem.start_fails = problem.training, False
    problem.loop, problem.spec = None, SimpleNamespace(aggregate=Mean())
    problem.space = SimpleNamespace(read=lambda loop: jnp.asarray([1.0, 2.0]))
    settings = BlackBoxSettings(method, 4, 0.5)
    with pytest.raises(CannotStart, match="members go astray with all of"):
        search_black_box(problem, settings, DescentSettings(steps=4), SilentProgress())
    assert 1 <= len(told[0].tried) <= 3
