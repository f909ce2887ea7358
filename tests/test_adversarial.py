"""Adversarial rounds: the worst members are found, tuned on, and get better.

The law pushes down with one number, and gliders start with different sinking speeds: no
push suits all, and the best for a few of them leaves one at the end of the box far off.
"""

import dataclasses
import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import AbstractController, ControlRecord, DesignModel, evaluate, paper
from jaxglider.control import Funnel, tracking_error
from jaxglider.control.prescribed.performance import ExponentialFunction
from jaxglider.core.containers import Scalar, as_float
from jaxglider.core.sets import Interval
from jaxglider.signals import Command
from jaxglider.uncertainty.distributions import Uniform
from jaxglider.uncertainty.members import Quantity, Uncertainty, with_member
from tuning.api.tune import solve
from tuning.evaluation.sections import adversarial_section
from tuning.problem.members import TEST, TRAINING, VALIDATION, sample_members
from tuning.problem.spec import EnsembleSpec, ProblemSpec
from tuning.reporting.console import SilentProgress
from tuning.search.adversarial import FOUND, worst_apart
from tuning.search.attack import severity
from tuning.search.settings import BlackBoxSettings, DescentSettings
from tuning.search.worst import find_worst

ROUNDS, RANDOM = 2, 2
SETTINGS = DescentSettings(steps=12, learning_rate=0.3, copies=1, spread=0.0)


class Push(AbstractController):
    """One buoyancy mass, whatever the glider does."""

    model: DesignModel
    funnel: Funnel
    push: Scalar = eqx.field(default=0.0, metadata={"set": Interval(-0.4, 0.4)})

    def init(self):
        return None

    def step(self, state, measurement, reference, bounds, dt):
        error, rate = tracking_error(measurement, reference)
        none = jnp.zeros_like(self.push)
        return Command(self.push, none, none), state, ControlRecord(error, rate)


def squares(metrics, start):
    return 1e3 * metrics.channels.depth.rms_error**2 + 1e-3


def _with_depth_specified(scenario):
    """The scenario with nothing specified of pitch and heading, in effect."""
    prescribed = scenario.specification
    performance = prescribed.funnel.performance
    wide = ExponentialFunction(as_float(200.0), as_float(100.0), as_float(100.0))
    performance = dataclasses.replace(performance, pitch=wide, heading=wide)
    funnel = dataclasses.replace(prescribed.funnel, performance=performance)
    prescribed = dataclasses.replace(prescribed, funnel=funnel, largest_roll=None)
    return dataclasses.replace(scenario, specification=prescribed)


@pytest.fixture(scope="module")
def spec():
    loop = paper.make_loop("switching", "printed", "smc", duration=4.0, dt=0.2)
    law = Push(loop.controller.model, loop.controller.funnel, as_float(0.0))
    loop = eqx.tree_at(lambda at: at.controller, loop, law)
    scenario = _with_depth_specified(loop.scenario)
    loop = dataclasses.replace(loop, scenario=scenario)
    quantities = (
        Quantity("heave", "initial_state.heave", "m/s", Uniform(-0.2, 0.3)),
        Quantity("sway", "initial_state.sway", "m/s", Uniform(-0.01, 0.01)),
    )
    return ProblemSpec.of_loop(
        loop,
        free=("controller.push",),
        ensemble=EnsembleSpec(Uncertainty(scenario, quantities), RANDOM, RANDOM, 3),
        cost=squares,
        constraints=(),
        gradient_memory=None,
    )


@pytest.fixture(scope="module")
def tuned(spec, tmp_path_factory):
    out = tmp_path_factory.mktemp("rounds")
    result = solve(spec, SETTINGS, adversarial=ROUNDS, out=out, check=False)
    return result, out


def test_the_worst_member_gets_better(tuned):
    """By the searches, and by a grid over the box with the gains before and after."""
    result, _ = tuned
    first, *_, last = result.searches
    assert last.worst < 0.9 * first.worst
    before = [x for x in result.history if x.number <= first.step]
    before = min(before[:-1], key=lambda x: x.validation)
    space, own = result.problem.space, result.problem.loop
    box = result.problem.spec.ensemble.on(own)
    grid = np.stack([np.linspace(0.0, 1.0, 41), np.full(41, 0.5)], axis=1)
    members = box.members(box.values(grid), jax.random.split(jax.random.key(0), 41))

    @jax.jit
    def worst_of(loop):
        one = lambda member: severity(evaluate(*with_member(loop, member)), loop)
        return jnp.max(jax.vmap(one)(members))

    values = [float(worst_of(x)) for x in (space.write(own, before.free), result.loop)]
    assert values[1] < 0.9 * values[0]
    # The search comes to what the grid says.
    np.testing.assert_allclose([first.worst, last.worst], values, rtol=0.02)


def test_the_members_found_are_trained_on_and_chosen_by(tuned, spec):
    problem, searches = tuned[0].problem, tuned[0].searches
    assert len(searches) == ROUNDS + 1
    found = [one["heave"] for s in searches[:-1] for one in s.members]
    assert len(found) == ROUNDS * FOUND
    box = spec.ensemble.on(spec.loop)
    for members, kind in (
        (problem.training, TRAINING),
        (problem.validation, VALIDATION),
    ):
        heave = np.asarray(members.values["initial_state.heave"])
        np.testing.assert_array_equal(heave[RANDOM:], found)
        drawn = sample_members(box, 0, kind, RANDOM).values["initial_state.heave"]
        np.testing.assert_array_equal(heave[:RANDOM], drawn)
    held_out = sample_members(box, 0, TEST, 3).values
    for path, values in problem.test.values.items():
        np.testing.assert_array_equal(values, held_out[path])


def test_the_rounds_are_reported(tuned):
    result, _ = tuned
    about = json.loads(json.dumps(result.to_dict()["adversarial"]))
    assert about["joined"] == ROUNDS * FOUND
    severities = [one["severity"] for one in about["searches"]]
    assert severities == [one.severity for one in result.searches]
    section = "\n".join(adversarial_section(about))
    for one in result.searches:
        assert f"| after step {one.step} | {one.severity:.4g} |" in section
    assert f"{ROUNDS * FOUND} found members joined" in str(result)
    assert adversarial_section(None) == []


class Stop(SilentProgress):
    """Interrupts in the third step of the second descent."""

    def __init__(self):
        self.steps = 0

    def show(self, text, at=None, total=None):
        self.steps += at is not None
        if at is not None and self.steps == SETTINGS.steps + 3:
            raise KeyboardInterrupt


def test_a_resumed_tuning_equals_an_uninterrupted_one(tuned, spec, tmp_path):
    options = {"adversarial": ROUNDS, "out": tmp_path, "check": False}
    part = solve(spec, SETTINGS, progress=Stop(), **options)
    assert part.interrupted
    assert len(part.searches) == 2
    whole = solve(spec, SETTINGS, resume=True, **options)
    assert whole.searches == tuned[0].searches
    for a, b in zip(whole.history, tuned[0].history, strict=True):
        assert (a.number, a.loss) == (b.number, b.loss)
        np.testing.assert_array_equal(a.free, b.free)
    with pytest.raises(ValueError, match="other options"):
        solve(spec, SETTINGS, resume=True, **options | {"adversarial": 1})


@pytest.mark.parametrize(
    ("changes", "method", "message"),
    [
        ({}, BlackBoxSettings("cma"), "adversarial must be 0 with cma"),
        ({"training": 1}, None, "adversarial must be 0 where nothing is uncertain"),
        ({"uncertainty": 0.0}, None, "adversarial must be 0 where nothing is"),
    ],
)
def test_rounds_without_a_descent_or_an_uncertainty_are_refused(
    spec, changes, method, message
):
    ensemble = dataclasses.replace(spec.ensemble, **changes)
    changed = dataclasses.replace(spec, ensemble=ensemble)
    with pytest.raises(ValueError, match=message):
        solve(changed, SETTINGS, method, adversarial=1)


def test_members_that_join_are_the_worst_and_apart():
    hill = lambda u: 3.0 - ((u - 0.7) ** 2).sum(axis=1)
    found = find_worst(hill, None, 3, 200)
    places = worst_apart(found, 4)
    assert hill(places)[0] == found.severity
    assert np.all(np.diff(hill(places)) <= 0.0)
    apart = np.sqrt(((places[:, None] - places[None]) ** 2).mean(axis=2))
    assert np.all(apart + np.eye(4) >= 0.1)
    # None that is left out is worse than one taken, and apart from those before it.
    worse = found.places[found.severities > hill(places)[-1]]
    near = np.sqrt(((worse[:, None] - places[None]) ** 2).mean(axis=2)).min(axis=1)
    assert np.all(near < 0.1)
