"""What costs are relative to where the nominal run comes to nothing."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import Calm, Specification, paper
from tuning.problem.baseline import baseline_metrics, comparable
from tuning.problem.objective import CHANNELS, DEFAULT_COST_SCALE, Objective
from tuning.problem.objective_file import DEFAULT_WEIGHTS
from tuning.problem.spec import EnsembleSpec, ProblemSpec
from tuning.search.rescue import is_lost

EDGES = {"depth": 0.2, "pitch": np.pi / 18, "heading": np.pi / 12}
LIMITS = {"depth": 0.4, "pitch": 0.06, "heading": np.pi / 2}


@pytest.fixture(scope="module")
def loop():
    # The law that compiles fastest.
    loop = paper.make_loop("switching", "printed", "smc", duration=20.0)
    judged = dataclasses.replace(
        loop.scenario, specification=Specification(paper.funnel("switching"))
    )
    return dataclasses.replace(loop, scenario=judged)


@pytest.fixture(scope="module")
def nominal(loop, evaluate_jit):
    return evaluate_jit(loop, loop.scenario.sea(jax.random.key(0)))


def test_an_ordinary_nominal_run_stays_as_it_is(loop, nominal):
    same = jax.tree.map(
        lambda a, b: np.array_equal(a, b, equal_nan=True),
        comparable(nominal, loop),
        nominal,
    )
    assert all(jax.tree.leaves(same))


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize("nothing", [0.0, 1e-17, 1e-6])
def test_edge_and_limit_stand_in_for_next_to_nothing(loop, nominal, channel, nothing):
    def quiet(of, value):
        measures = ("max_error", "rms_error", "rms_effort", "chattering")
        at = lambda m: [getattr(getattr(m.channels, channel), n) for n in measures]
        return eqx.tree_at(at, of, [jnp.asarray(value)] * len(measures))

    start = comparable(quiet(nominal, nothing), loop)
    found = getattr(start.channels, channel)
    edge, limit = EDGES[channel], LIMITS[channel]
    np.testing.assert_allclose(found.max_error, edge)
    np.testing.assert_allclose(found.rms_error, edge)
    np.testing.assert_allclose(found.rms_effort, limit)
    np.testing.assert_allclose(found.chattering, 0.01 * limit)
    others = [getattr(start.channels, c).rms_error for c in CHANNELS if c != channel]
    kept = [getattr(nominal.channels, c).rms_error for c in CHANNELS if c != channel]
    np.testing.assert_array_equal(others, kept)

    # A member that is a third of the edge off costs a third of the term's weight.
    weight = dict(zip(CHANNELS, DEFAULT_WEIGHTS.tracking, strict=True))[channel]
    objective = Objective(start, DEFAULT_WEIGHTS)
    none = objective(quiet(nominal, 0.0))
    off = eqx.tree_at(
        lambda m: getattr(m.channels, channel).rms_error,
        quiet(nominal, 0.0),
        jnp.asarray(edge / 3.0),
    )
    np.testing.assert_allclose(objective(off) - none, weight / 3.0, rtol=1e-9)

    def ratio(metrics, start):
        now, then = (getattr(m.channels, channel) for m in (metrics, start))
        return now.rms_error / then.rms_error + now.chattering / then.chattering

    own = Objective(start, cost=ratio)
    assert own.cost_scale() == pytest.approx(2.0)
    assert float(own(off)) == pytest.approx(1.0 / 3.0)


def test_members_that_start_off_a_heading_kept_exactly_are_not_lost(evaluate_jit):
    loop = paper.make_loop("switching", "printed", "fxtppc", duration=20.0)
    calm = eqx.tree_at(lambda x: x.scenario.disturbance, loop, Calm())
    straight = eqx.tree_at(
        lambda x: x.scenario.reference.schedule.heading,
        calm,
        jnp.zeros_like(calm.scenario.reference.schedule.heading),
    )
    sea = calm.scenario.sea(jax.random.key(0))
    nominal = evaluate_jit(straight, sea)
    assert float(nominal.channels.heading.rms_error) == 0.0
    objective = Objective(comparable(nominal, straight), DEFAULT_WEIGHTS)
    costs = [
        objective(
            evaluate_jit(
                eqx.tree_at(
                    lambda x: x.scenario.initial_state.heading,
                    straight,
                    jnp.asarray(np.radians(degrees)),
                ),
                sea,
            )
        )
        for degrees in (-5.0, 5.0, 10.0)
    ]
    assert not is_lost(jnp.stack(costs), DEFAULT_COST_SCALE)
    # What a start costs: its tracking, its chattering and its travel.
    restless = 3.0 * (DEFAULT_WEIGHTS.chattering + DEFAULT_WEIGHTS.travel)
    assert float(jnp.max(jnp.stack(costs))) < DEFAULT_COST_SCALE + restless


def test_without_a_funnel_of_the_scenario_the_laws_own_edges_count(loop, nominal):
    own = dataclasses.replace(
        loop, scenario=dataclasses.replace(loop.scenario, specification=None)
    )
    still = jax.tree.map(jnp.zeros_like, nominal)
    for channel, of in vars(comparable(still, own).channels).items():
        np.testing.assert_allclose(of.rms_error, EDGES[channel])


def test_a_course_that_is_over_at_its_start_is_nothing_to_tune():
    loop = paper.make_loop("waypoints", "printed", "smc", duration=5.0)
    at = lambda x: (x.scenario.reference.north, x.scenario.reference.east)
    loop = eqx.tree_at(at, loop, (jnp.asarray([1.0]), jnp.asarray([2.0])))
    spec = ProblemSpec.of_loop(loop, "near", ensemble=EnsembleSpec.nominal())
    with pytest.raises(ValueError, match="nothing to tune: the last waypoint"):
        baseline_metrics(spec, loop)
