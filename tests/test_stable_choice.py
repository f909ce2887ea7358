"""The choice of a search among its steps: the best with a stable loop."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider.control import ChannelGains
from tuning.problem.problem import TuningProblem
from tuning.problem.spec import EnsembleSpec, ProblemSpec
from tuning.search.settings import Step
from tuning.search.stable import stable_choice
from tuning.space.space import HELD_BY_DEFAULT, STABLE_LOOP


@pytest.fixture(scope="module")
def problem():
    """The paper's case on `seawing`, too short to fly any of it."""
    spec = ProblemSpec.of_paper(
        "switching", "seawing", "fxtppc", duration=1.0, ensemble=EnsembleSpec.nominal()
    )
    return TuningProblem.of(spec)


@pytest.fixture(scope="module")
def unstable(problem):
    """Free numbers of a heading that is sharp about zero, and a bank hardly damped."""
    law = problem.loop.controller
    heading = ChannelGains(0.002, 0.08, rho=0.8, mu=5.0)
    sharp = dataclasses.replace(
        law,
        gains=dataclasses.replace(law.gains, heading=heading),
        steering=dataclasses.replace(law.steering, bank_gain=0.5, roll_damping=1.0),
    )
    return problem.space.read(dataclasses.replace(problem.loop, controller=sharp))


def step(number, validation, free, refused=False):
    """A step of a search."""
    return Step(number, validation, validation, free, refused, False, 0.1)


def test_the_best_stable_step_is_chosen(problem, unstable):
    start = problem.space.read(problem.loop)
    history = [
        step(0, 5.0, start),
        step(1, 4.0, start + 1e-3),
        step(2, 3.0, unstable),
        step(3, 1.0, start, refused=True),
    ]
    free, remarks = stable_choice(problem, unstable, history)
    np.testing.assert_array_equal(free, start + 1e-3)
    choice, stability = remarks
    assert "step 1, the best with a stable loop: 4" in choice
    assert "3 is the best of all" in choice
    assert stability.startswith("the loop is stable on 6 straight glides")


def test_stable_gains_are_kept(problem):
    start = problem.space.read(problem.loop)
    free, (stability,) = stable_choice(problem, start, [step(0, 5.0, start)])
    np.testing.assert_array_equal(free, start)
    assert stability.startswith("the loop is stable")


def test_where_no_step_is_stable_the_best_is_kept_and_that_is_said(problem, unstable):
    free, remarks = stable_choice(problem, unstable, [step(0, 5.0, unstable)])
    np.testing.assert_array_equal(free, unstable)
    assert remarks[0] == "no step has a stable loop (1 looked at)."
    assert remarks[1].startswith("the loop is NOT stable")


def test_who_lets_go_of_the_constraint_gets_the_best(problem, unstable):
    held = tuple(name for name in HELD_BY_DEFAULT if name != STABLE_LOOP)
    spec = dataclasses.replace(problem.spec, constraints=held)
    free, (stability,) = stable_choice(
        dataclasses.replace(problem, spec=spec), unstable, [step(0, 5.0, jnp.zeros(1))]
    )
    np.testing.assert_array_equal(free, unstable)
    assert stability.startswith("the loop is NOT stable")
