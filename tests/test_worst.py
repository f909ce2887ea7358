"""The search for the worst member finds worst cases that are known."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import evaluate, paper
from jaxglider.uncertainty.members import with_member
from tuning.api.worst import worst
from tuning.problem.spec import EnsembleSpec
from tuning.search.attack import Attack, severity
from tuning.search.evolution import GRADIENT_COST
from tuning.search.worst import find_worst, folded

SIZE = 12
LIMIT = 1e-5
"""Bank limit that decides, of a run too short to roll far [rad]."""


def corner(u):
    """Worst in a corner: 1 + Σ wᵢ |…|, 7 at most."""
    weights = np.linspace(0.1, 0.9, SIZE)
    side = np.where(np.arange(SIZE) % 2, u, 1.0 - u)
    return 1.0 + (side * weights).sum(axis=1)


def corner_slope(u):
    weights = np.linspace(0.1, 0.9, SIZE)
    slope = np.where(np.arange(SIZE) % 2, weights, -weights)
    return corner(u), np.tile(slope, (len(u), 1))


CENTRE = np.linspace(0.2, 0.8, SIZE)


def hill(u):
    """Worst inside, at CENTRE, where it is 3."""
    return 3.0 - ((u - CENTRE) ** 2).sum(axis=1)


def hill_slope(u):
    return hill(u), -2.0 * (u - CENTRE)


@pytest.mark.parametrize(
    ("severity", "slope", "worst"),
    [(corner, corner_slope, 7.0), (hill, hill_slope, 3.0)],
    ids=["corner", "inside"],
)
def test_a_known_worst_case_is_found_to_a_percent(severity, slope, worst):
    calls = []

    def counted(u):
        calls.append(len(u))
        assert np.all((u >= 0.0) & (u <= 1.0))
        return severity(u)

    def counted_slope(u):
        calls.append(GRADIENT_COST * len(u))
        return slope(u)

    found = find_worst(counted, counted_slope, SIZE, 400, seed=1)
    assert found.severity == pytest.approx(worst, rel=0.01)
    assert severity(found.place[None])[0] == found.severity
    assert sum(calls) == found.rollouts <= 400
    # Two thousand at random come nowhere near the corner.
    random = severity(np.random.default_rng(0).uniform(size=(2000, SIZE)))
    assert found.severity > random.max()
    without = find_worst(severity, None, SIZE, 3000, seed=1)
    assert without.severity == pytest.approx(worst, rel=0.01)
    assert "gradient" not in without.best


def test_a_misleading_gradient_does_no_harm():
    def wrong(u):
        values, slope = hill_slope(u)
        return values, np.where(np.arange(SIZE) == 0, np.nan, -slope)

    found = find_worst(hill, wrong, SIZE, 1500, seed=0)
    assert found.severity == pytest.approx(3.0, rel=0.01)
    assert found.found_by == "cma"


def test_a_run_that_fails_is_the_worst_there_is():
    broken = lambda u: np.where(u[:, 0] > 0.9, np.nan, 1.0)
    found = find_worst(broken, None, SIZE, 200)
    assert found.severity == np.inf
    assert found.place[0] > 0.9


def test_all_numbers_are_folded_into_the_cube():
    z = np.array([-0.25, 0.0, 0.4, 1.0, 1.3, 2.0, 5.1])
    np.testing.assert_allclose(folded(z), [0.25, 0.0, 0.4, 1.0, 0.7, 0.0, 0.9])


def test_a_budget_too_small_is_refused():
    with pytest.raises(ValueError, match="at least 16"):
        find_worst(hill, None, SIZE, 10)


@pytest.fixture(scope="module")
def loop():
    loop = paper.make_loop("switching", "rigid-body", "smc", duration=4.0)
    prescribed = loop.scenario.specification
    scenario = dataclasses.replace(
        loop.scenario, specification=dataclasses.replace(prescribed, largest_roll=LIMIT)
    )
    return dataclasses.replace(loop, scenario=scenario)


@pytest.fixture(scope="module")
def attack(loop):
    box = EnsembleSpec(0.2).on(loop)
    return Attack(dataclasses.replace(loop, scenario=box.scenario), box, 0), box


def test_the_slope_in_the_cube_is_that_of_differences(attack):
    """Over a run that is short beside the memory of the gradient."""
    search, box = attack
    place = np.full((4, len(box.quantities)), 0.4)
    values, slope = search.slopes(place)
    np.testing.assert_allclose(values, search.severities(place), rtol=1e-9)
    steepest = int(np.argmax(np.abs(slope[0])))
    ends = place[:2].copy()
    ends[:, steepest] += [-1e-3, 1e-3]
    low, high = search.severities(ends)
    difference = (high - low) / 2e-3
    assert slope[0, steepest] == pytest.approx(difference, rel=0.15)
    assert abs(difference) > 0.1


def test_the_worst_of_a_box_is_worse_than_random_and_inside(loop, attack):
    found = worst(loop, budget=120, random=64, seed=0)
    assert found.case.rollouts <= 120
    assert found.case.severity >= found.random_worst
    assert found.missed == 64
    for quantity in attack[1].quantities:
        ends = sorted(quantity.values(np.array([0.0, 1.0])))
        inside = found.values[quantity.name]
        assert ends[0] - 1e-9 <= inside <= ends[1] + 1e-9
    member = jax.tree.map(lambda x: x[0], found.member)
    metrics = jax.jit(lambda m: evaluate(*with_member(found.loop, m)))(member)
    assert float(severity(metrics, found.loop)) == pytest.approx(found.case.severity)
    assert found.metrics["max_roll_rad"] == pytest.approx(float(metrics.max_roll))
    text = str(found)
    assert "64 are less severe" in text
    assert json.loads(json.dumps(found.to_dict()))["random"]["less_severe"] == 64


def test_severity_is_of_what_is_broken_most(loop):
    run = jax.jit(evaluate)
    metrics = run(loop, loop.scenario.sea(jax.random.key(0)))
    peaks = [float(c.funnel_peak) for c in vars(metrics.channels).values()]
    roll = float(metrics.max_roll) / LIMIT
    assert float(severity(metrics, loop)) == pytest.approx(max(*peaks, roll))
    free = dataclasses.replace(loop.scenario.specification, largest_roll=None)
    scenario = dataclasses.replace(loop.scenario, specification=free)
    free = dataclasses.replace(loop, scenario=scenario)
    assert float(severity(metrics, free)) == pytest.approx(max(peaks))
    failed = dataclasses.replace(metrics, finite=jnp.asarray(False))
    assert float(severity(failed, loop)) == np.inf
