"""Objective, members, descent and checkpoint, on toys and on the paper's case."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import paper
from jaxglider.signals import CHANNELS
from jaxglider.simulation.rollout import evaluate
from jaxglider.uncertainty.members import Member, with_member
from jaxglider.uncertainty.quantities import uniform_uncertainty
from tuning.evaluation.held_out import paired_means
from tuning.problem.aggregates import CVaR, Mean, SoftWorst, make_aggregate
from tuning.problem.lanes import FAILED_COST, saturate_cost, scattered
from tuning.problem.members import (
    SWEEP,
    TEST,
    TRAINING,
    VALIDATION,
    and_nominal,
    nominal_member,
    sample_members,
)
from tuning.problem.objective import DEFAULT_COST_SCALE, Objective, Weights
from tuning.problem.objective_file import DEFAULT_WEIGHTS, load_cost
from tuning.search.checkpoint import Checkpoint
from tuning.search.descent import Descent
from tuning.search.settings import DescentSettings
from tuning.space.space import Space

K1_AND_K2 = ("controller.gains.*.k1", "controller.gains.*.k2")
ALONE = jnp.zeros((1, 1))


@pytest.fixture(scope="module")
def loop():
    return paper.make_loop("switching", "printed", duration=20.0)


def _descend(loss, start, **options):
    settings = DescentSettings(
        **{"copies": 1, "spread": 0.0, "patience": 10**6} | options
    )
    descent = Descent(lambda free, _: loss(free), ALONE, ALONE, settings)
    state = descent.start(start)
    states, steps = [state], []
    for reached, step in descent.run(state):
        states.append(reached)
        steps.append(step)
    return states, steps


def test_copies_are_centred_and_depend_on_the_key_alone():
    centre = jnp.arange(4.0)
    copies = scattered(centre, jax.random.key(3), 11, 0.1)
    assert copies.shape == (11, 4)
    np.testing.assert_allclose(jnp.mean(copies, axis=0), centre, atol=1e-12)
    assert np.std(np.asarray(copies - centre)) == pytest.approx(0.1, rel=0.5)
    np.testing.assert_array_equal(copies, scattered(centre, jax.random.key(3), 11, 0.1))


def test_aggregates_agree_with_numpy():
    costs = np.array([1.0, 5.0, 2.0, 4.0, 3.0])
    value, weights = Mean()(jnp.asarray(costs))
    assert float(value) == pytest.approx(3.0)
    value, weights = CVaR(0.5)(jnp.asarray(costs))
    assert float(value) == pytest.approx((5.0 + 4.0 + 0.5 * 3.0) / 2.5)
    assert float(jnp.sum(weights)) == pytest.approx(1.0)
    value, weights = SoftWorst(200.0)(jnp.asarray(costs))
    assert float(value) == pytest.approx(5.0 - np.log(5) / 200.0)
    np.testing.assert_allclose(weights, [0, 1, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("kind", ["mean", "cvar", "worst"])
def test_weights_of_an_aggregate_are_its_gradient(kind):
    aggregate = make_aggregate(kind, share=0.3)
    costs = jnp.array([0.3, 1.9, 0.7, 1.2, 0.1, 1.5, 0.9])
    slope = jax.grad(lambda c: aggregate(c)[0])(costs)
    np.testing.assert_allclose(aggregate(costs)[1], slope, atol=1e-12)


@pytest.mark.parametrize(
    "make",
    [
        lambda: make_aggregate("median"),
        lambda: make_aggregate("cvar", share=0.0),
        lambda: Weights(tracking=-1.0),
        lambda: Weights(tracking=0.0),
        lambda: Weights(tracking=(1.0, 1.0)),
        lambda: Weights(effort=(1.0, -1.0, 1.0)),
        lambda: Weights(roll=float("nan")),
        lambda: DescentSettings(steps=0),
        lambda: DescentSettings(learning_rate=-1.0),
        lambda: DescentSettings(worse=1.0),
        lambda: DescentSettings(starts=0),
        lambda: DescentSettings(start_spread=0.0),
        lambda: DescentSettings(optimiser="newton"),
    ],
)
def test_numbers_out_of_range_are_refused(make):
    with pytest.raises(ValueError, match=r"must be|zero"):
        make()


def test_objective_is_three_at_the_start_and_its_slope_is_right(evaluate_jit):
    # The law that compiles fastest: the objective is the same for all.
    loop = paper.make_loop("switching", "printed", "smc", duration=20.0)
    sea = loop.scenario.sea(jax.random.key(0))
    weights = Weights(1.0, 0.1, 0.02, 20.0, 5.0, 0.3, 0.5)
    start = evaluate_jit(loop, sea)
    assert float(Objective(start)(start)) == pytest.approx(3.0, abs=1e-9)
    objective = Objective(start, weights)
    space = Space.of(loop, ("controller.c0.*", "controller.c1.*"), ())
    free = space.read(loop)

    def loss(x):
        return objective(evaluate(space.write(loop, x), sea))

    direction = jnp.array([1.0, -0.5, 0.3, 0.7, -0.2, 0.4])
    along = jax.jit(jax.value_and_grad(lambda t: loss(free + t * direction)))
    slope, h = along(0.0)[1], 1e-5
    difference = (along(h)[0] - along(-h)[0]) / (2 * h)
    np.testing.assert_allclose(slope, difference, rtol=1e-5)


def test_terms_are_what_they_are_called(loop, evaluate_jit):
    start = evaluate_jit(loop, loop.scenario.sea(jax.random.key(0)))
    terms = Objective(start, Weights(roll_limit=0.1)).terms(start)
    np.testing.assert_allclose(terms["tracking"], 1.0, atol=1e-9)
    np.testing.assert_allclose(terms["effort"], 1.0, atol=1e-6)
    np.testing.assert_allclose(terms["chattering"], 1.0, atol=1e-4)
    for name, measure in (
        ("crowding", "funnel_crowding"),
        ("saturation", "saturation_excess"),
    ):
        found = [getattr(getattr(start.channels, c), measure) for c in CHANNELS]
        np.testing.assert_array_equal(terms[name], found)


def test_a_weight_counts_in_its_own_channel_and_roll_beyond_its_limit(
    loop, evaluate_jit
):
    start = evaluate_jit(loop, loop.scenario.sea(jax.random.key(0)))
    weights = Weights(tracking=(1.0, 2.0, 4.0), crowding=(0.0, 0.0, 8.0))
    wanted = 7.0 + 8.0 * float(start.channels.heading.funnel_crowding)
    assert float(Objective(start, weights)(start)) == pytest.approx(wanted, abs=1e-9)
    limit = float(start.max_roll) - 0.1
    rolled = Objective(start, Weights(tracking=0.0, roll=5.0, roll_limit=limit))
    assert float(rolled(start)) == pytest.approx(5.0 * 0.1**2)


def test_a_cost_of_the_users_own_takes_the_place_of_all_terms(
    tmp_path, loop, evaluate_jit
):
    file = tmp_path / "mine.py"
    file.write_text(
        "def steep(metrics, start):\n    return metrics.max_roll**2 / start.max_roll\n"
    )
    start = evaluate_jit(loop, loop.scenario.sea(jax.random.key(0)))
    objective = Objective(start, cost=load_cost(f"{file}:steep"))
    assert float(objective(start)) == pytest.approx(float(start.max_roll))
    assert objective.cost_scale() == pytest.approx(float(start.max_roll))


@pytest.mark.parametrize(
    ("weights", "unit"),
    [
        (DEFAULT_WEIGHTS, DEFAULT_COST_SCALE),
        (Weights(tracking=(0.5, 1.0, 6.0), crowding=100.0), 7.5),
        (Weights(tracking=0.0, effort=1.0, chattering=(2.0, 0.0, 0.0), roll=9.0), 5.0),
        (Weights(tracking=0.0, crowding=2.0, saturation=1.0), 9.0),
        (Weights(tracking=0.0, roll=5.0), 5.0),
    ],
)
def test_the_unit_of_an_objective_is_what_its_first_terms_weigh(weights, unit):
    assert Objective(None, weights).cost_scale() == pytest.approx(unit)


@pytest.mark.parametrize(
    ("cost", "message"),
    [
        (lambda metrics, start: -3.0, "positive at the start.*gives -3"),
        (lambda metrics, start: float("nan"), "positive at the start.*gives nan"),
        (lambda metrics, start: jnp.ones(3), "one number"),
    ],
)
def test_a_cost_without_a_unit_is_refused(cost, message):
    with pytest.raises(ValueError, match=message):
        Objective(None, cost=cost).cost_scale()


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        ("def f(m, s): return 0", "g", "has no FUNCTION 'g'"),
        ("f = 3", "f", "must name a function"),
        ("import nowhere_to_be_found", "f", "cannot be run"),
        (None, "f", "existing file"),
    ],
)
def test_a_cost_that_cannot_be_used_is_refused(tmp_path, text, name, message):
    file = tmp_path / "mine.py"
    if text is not None:
        file.write_text(text)
    with pytest.raises(ValueError, match=message):
        load_cost(f"{file}:{name}")


def test_member_is_the_same_whatever_the_count_and_sets_share_none(loop):
    spread = uniform_uncertainty(loop.scenario, 0.2, 0.5)
    few = sample_members(spread, 7, TRAINING, 3)
    many = sample_members(spread, 7, TRAINING, 9)
    for a, b in zip(jax.tree.leaves(few), jax.tree.leaves(many), strict=True):
        np.testing.assert_array_equal(a, b[:3])
    drags = [
        np.asarray(sample_members(spread, 7, kind, 20).values["plant.parameters.drag"])
        for kind in (TRAINING, VALIDATION, TEST, SWEEP)
    ]
    assert len(np.unique(np.concatenate(drags))) == 80


def test_nominal_member_is_the_loop_itself(loop, evaluate_jit):
    member = jax.tree.map(lambda x: x[0], nominal_member(loop))
    there = evaluate_jit(*with_member(loop, member))
    here = evaluate_jit(loop, loop.scenario.sea(jax.random.key(0)))
    for a, b in zip(jax.tree.leaves(there), jax.tree.leaves(here), strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_nominal_case_flies_behind_the_members_it_joins(loop):
    spread = uniform_uncertainty(loop.scenario, 0.2, 0.5)
    varied = dataclasses.replace(loop, scenario=spread.scenario)
    few = sample_members(spread, 7, TEST, 3)
    every = and_nominal(few, varied)
    for a, b in zip(jax.tree.leaves(few), jax.tree.leaves(every), strict=True):
        np.testing.assert_array_equal(a, b[:3])
    last = with_member(varied, jax.tree.map(lambda x: x[3], every))
    own = with_member(varied, jax.tree.map(lambda x: x[0], nominal_member(varied)))
    for a, b in zip(jax.tree.leaves(last), jax.tree.leaves(own), strict=True):
        np.testing.assert_array_equal(a, b)
    # An actuator without a limit of its speed has no number for it.
    rate = Member({"actuators.mass_angle.rate_limit": jnp.ones(3)}, few.key)
    assert and_nominal(rate, paper.make_loop(actuators="ideal", duration=1.0)) is None


def test_descent_finds_the_bottom_of_a_bowl():
    bowl = lambda x: jnp.sum((x - jnp.array([1.0, -2.0])) ** 2)
    states, steps = _descend(bowl, jnp.zeros(2), steps=200)
    assert len(steps) == 200
    np.testing.assert_allclose(states[-1].chosen_free[0], [1.0, -2.0], atol=1e-2)


@pytest.mark.parametrize("optimiser", ["adam", "sgd", "rmsprop", "nadam"])
def test_every_optimiser_descends(optimiser):
    bowl = lambda x: jnp.sum(x**2)
    states, _ = _descend(bowl, jnp.ones(2), steps=60, optimiser=optimiser)
    assert float(states[-1].best.loss[0]) < 0.2


def test_a_step_into_nan_is_refused_and_the_next_is_shorter():
    """Descending 1/x towards larger x runs into a wall of NaN at x = 2."""
    wall = lambda x: jnp.where(x[0] < 2.0, 1.0 / x[0], jnp.nan)
    states, steps = _descend(wall, jnp.ones(1), steps=60, learning_rate=0.3)
    refused = [i for i, s in enumerate(steps) if s.refused]
    assert refused
    schedule = 0.3 * 0.5 * (1.0 + np.cos(np.pi * np.arange(60) / 60))
    shares = [s.learning_rate for s in steps] / schedule
    for i in refused:
        assert steps[i].loss == FAILED_COST * DEFAULT_COST_SCALE
        if i + 1 < len(steps):
            assert shares[i + 1] == pytest.approx(0.5 * shares[i])
    assert all(float(s.current.free[0, 0]) < 2.0 for s in states)
    assert float(states[-1].chosen_loss[0]) < 0.52


def test_a_step_that_was_shortened_grows_again():
    """A refusal halves the step, an accepted one adds a tenth, up to the whole."""
    cliff = lambda x: jnp.where(x[0] < 0.35, 1.0 - x[0], jnp.nan)
    states, steps = _descend(cliff, jnp.zeros(1), steps=40, optimiser="sgd")
    shrink = [float(s.shrink[0]) for s in states]
    for before, step, after in zip(shrink[:-1], steps, shrink[1:], strict=True):
        factor = 0.5 if step.refused else 1.1
        assert after == pytest.approx(min(factor * before, 1.0))
    assert {s.refused for s in steps} == {True, False}


def test_of_several_starts_the_one_in_the_deeper_valley_is_chosen():
    """From x = 1 the near valley is at 1 and shallow; the deep one is at -2."""
    valleys = lambda x: jnp.minimum(
        (x[0] - 1.0) ** 2 + 1.0, (x[0] + 2.0) ** 2 + 0.5 * x[1] ** 2
    )
    start = jnp.array([1.0, 0.0])
    options = {"steps": 80, "learning_rate": 0.1, "start_spread": 2.0}
    alone, _ = _descend(valleys, start, **options)
    many, steps = _descend(valleys, start, starts=8, **options)
    assert float(alone[-1].chosen_loss[0]) == pytest.approx(1.0)
    np.testing.assert_array_equal(many[0].current.free[0], start)
    leader = many[-1].leader()
    assert float(many[-1].chosen_loss[leader]) < 0.02
    np.testing.assert_allclose(many[-1].chosen_free[leader], [-2.0, 0.0], atol=0.15)
    assert steps[-1].validation <= float(np.max(many[-1].chosen_loss))


def _bowl(slope):
    """x² with a derivative of our own."""

    @jax.custom_jvp
    def bowl(x):
        return jnp.sum(x**2)

    @bowl.defjvp
    def _(primals, tangents):
        return bowl(primals[0]), jnp.vdot(slope(primals[0]), tangents[0])

    return bowl


def test_the_surrogate_steers_and_the_loss_judges():
    """A surrogate of the same values, its derivative pointing up the hill."""
    hill = _bowl(lambda x: -2.0 * x)
    settings = DescentSettings(steps=5, copies=1, spread=0.0, worse=10.0)
    descent = Descent(
        lambda free, _: jnp.sum(free**2),
        *(ALONE, ALONE, settings),
        surrogate_loss=lambda free, _: hill(free),
    )
    state = descent.start(jnp.ones(2))
    _, step = descent.advance(state)
    assert step.validation > float(state.current.loss[0])
    assert not step.best


def test_every_member_has_its_turn_in_the_gradient_and_all_judge():
    """Member i pulls along axis i alone: a slope shows whose turn it was."""
    members, settings = (
        jnp.eye(6),
        DescentSettings(steps=9, batch=2, copies=1, spread=0.0),
    )
    descent = Descent(lambda x, member: x @ member, members, members, settings)
    state = descent.start(jnp.ones(6))
    turns = [np.asarray(state.current.slope[0])]
    for _ in range(5):
        state, step = descent.advance(state)
        turns.append(np.asarray(state.current.slope[0]))
        assert step.loss == pytest.approx(float(jnp.mean(step.free)))
    np.testing.assert_allclose([np.count_nonzero(slope) for slope in turns], 2)
    for deal in (turns[:3], turns[3:]):
        np.testing.assert_allclose(np.sum(deal, axis=0), 0.5)
    assert not np.array_equal(turns[:3], turns[3:])


@pytest.mark.parametrize(
    ("kind", "members", "batch", "cost"),
    [("mean", 32, 16, 112), ("mean", 4, 4, 44), ("cvar", 32, 32, 192)],
)
def test_a_batch_and_what_a_step_with_it_costs(kind, members, batch, cost):
    settings, aggregate = DescentSettings(), make_aggregate(kind)
    assert settings.batch_of(members, aggregate) == batch
    assert settings.gradient_cost(members, aggregate) == cost


def test_a_step_over_a_cliff_goes_back_to_the_best_gains():
    cliff = lambda x: jnp.where(x[0] < 1.0, 2.0 - x[0], 50.0 + 0.0 * x[0])
    states, steps = _descend(cliff, jnp.zeros(1), steps=12, learning_rate=0.4)
    number = next(i for i, s in enumerate(steps) if s.refused)
    np.testing.assert_array_equal(
        states[number + 1].current.free, states[number].best.free
    )


def test_the_costly_part_compiles_once_on_several_devices():
    settings = DescentSettings(steps=3, copies=2, spread=0.01)
    descent = Descent(
        *(lambda free, _: jnp.sum(free**2), ALONE, ALONE, settings),
        devices=jax.devices(),
    )
    assert len(list(descent.run(descent.start(jnp.ones(2))))) == 3
    assert descent._evaluate_jit.compiled._cache_size() == 1


def test_what_is_chosen_is_best_on_the_validation_set():
    """Training wants x = 3, validation x = 1: the answer is near 1."""
    settings = DescentSettings(
        steps=200, learning_rate=0.05, copies=1, spread=0.0, patience=10**6
    )
    loss = lambda free, member: jnp.sum((free - member) ** 2)
    descent = Descent(loss, jnp.full((1, 1), 3.0), jnp.full((1, 1), 1.0), settings)
    state = descent.start(jnp.zeros(1))
    for reached, _ in descent.run(state):
        state = reached
    assert float(state.current.free[0, 0]) == pytest.approx(3.0, abs=0.1)
    assert float(state.chosen_free[0, 0]) == pytest.approx(1.0, abs=0.05)


def test_descent_stops_on_a_plateau():
    flat = lambda x: 1.0 + 0.0 * jnp.sum(x)
    _, steps = _descend(flat, jnp.zeros(1), steps=100, patience=7)
    assert len(steps) == 7


def test_descent_ends_where_no_gradient_is_finite():
    blind = _bowl(lambda x: jnp.inf * x)
    states, steps = _descend(blind, jnp.ones(2), steps=50)
    assert steps == []
    assert int(states[0].blind[0]) == 1


def test_one_blind_descent_does_not_end_the_others():
    """No gradient below zero: of starts on both sides those above go on."""
    half_blind = _bowl(lambda x: jnp.where(x > 0.0, 2.0 * x, jnp.nan))
    options = {"starts": 8, "start_spread": 1.0, "learning_rate": 0.05}
    states, steps = _descend(half_blind, jnp.full(1, -0.1), steps=6, **options)
    assert len(steps) == 6
    blind = np.asarray(states[0].blind)
    assert set(blind) == {0, 1}
    assert blind[0] == 1


def test_one_wild_gradient_does_not_carry_the_mean_away():
    """Slopes of up to 1e6 in a gentle descent: clipped, none can dominate."""
    spiky = lambda x: x[0] + 1e-3 * jnp.sin(1e9 * x[0])
    states, _ = _descend(spiky, jnp.zeros(1), steps=1, copies=16, spread=0.1)
    assert abs(float(states[0].current.slope[0, 0])) <= 1.0


def test_a_steep_member_is_heard_and_a_chaotic_one_is_not():
    """Three members gain one per unit; the fourth loses six, or a thousand million."""

    def slope(steep):
        members = jnp.asarray([-1.0, -1.0, -1.0, steep])
        settings = DescentSettings(steps=1, batch=4, copies=4, spread=0.0)
        loss = lambda free, member: member * jnp.sum(free)
        descent = Descent(loss, members, members, settings)
        return float(descent.start(jnp.zeros(1)).current.slope[0, 0])

    np.testing.assert_allclose(slope(6.0), 0.75, rtol=1e-12)
    np.testing.assert_allclose(slope(1e9), -0.75, rtol=1e-6)


def test_a_start_that_is_not_finite_is_said_so():
    with pytest.raises(FloatingPointError, match="not finite at the starting gains"):
        _descend(lambda x: jnp.sum(x) * jnp.nan, jnp.zeros(2))


def test_a_resumed_descent_equals_an_uninterrupted_one_bit_for_bit(tmp_path):
    wavy = lambda x: jnp.sum(x**2) + jnp.sin(5.0 * x[0]) * jnp.cos(3.0 * x[1])
    options = {"steps": 25, "copies": 6, "spread": 0.05, "learning_rate": 0.2}
    options["starts"] = 3
    whole, _ = _descend(wavy, jnp.array([1.0, -2.0]), **options)
    settings = DescentSettings(**options, patience=10**6)
    make = lambda: Descent(lambda free, _: wavy(free), ALONE, ALONE, settings)
    path = tmp_path / "checkpoint.npz"
    descent, history = make(), []
    for state, step in descent.run(descent.start(jnp.array([1.0, -2.0]))):
        history.append(step)
        Checkpoint(path, "same").save(state, history)
        if step.number == 9:
            break
    fresh = make()
    state, steps = Checkpoint(path, "same").load(fresh.start(jnp.array([1.0, -2.0])))
    assert [s.number for s in steps] == list(range(1, 10))
    for reached, _ in fresh.run(state):
        state = reached
    for a, b in zip(jax.tree.leaves(whole[-1]), jax.tree.leaves(state), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_checkpoint_of_other_options_or_a_broken_one_is_refused(tmp_path):
    states, _ = _descend(lambda x: jnp.sum(x**2), jnp.ones(2), steps=1)
    path = tmp_path / "checkpoint.npz"
    with pytest.raises(ValueError, match="run without --resume"):
        Checkpoint(path, "a").load(states[0])
    Checkpoint(path, "a").save(states[1], [])
    with pytest.raises(ValueError, match="other options"):
        Checkpoint(path, "b").load(states[0])
    path.write_bytes(path.read_bytes()[:50])
    with pytest.raises(ValueError, match="cannot be read"):
        Checkpoint(path, "a").load(states[0])


def test_paired_interval_is_students_and_ignores_failed_pairs():
    rng = np.random.default_rng(0)
    before = rng.normal(1.0, 0.2, 400)
    after = before - 0.1 + rng.normal(0.0, 0.05, 400)
    after[3] = np.nan
    row = paired_means(before, after)
    assert row.pairs == 399
    low, high = row.interval
    assert low < -0.1 < high
    assert high - low == pytest.approx(2 * 1.966 * 0.05 / np.sqrt(399), rel=0.1)
    assert paired_means(before[:1], after[:1]).interval is None
    assert paired_means(np.array([np.nan]), np.array([1.0])).pairs == 0


def test_paired_intervals_cover_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(2000):
        before = rng.normal(0.0, 1.0, 12)
        low, high = paired_means(before, before + rng.normal(0.3, 1.0, 12)).interval
        hits += low < 0.3 < high
    assert 0.935 < hits / 2000 < 0.965


def test_tuning_the_paper_case_halves_the_objective(evaluate_jit):
    """The sum of the three relative errors goes from 3 to 1.5 or less in 15 steps."""
    # The first of its four segments.
    loop = paper.make_loop("switching", "printed", duration=200.0, dt=0.2)
    sea = loop.scenario.sea(jax.random.key(0))
    objective = Objective(evaluate_jit(loop, sea))
    space = Space.of(loop, K1_AND_K2, ())
    member = nominal_member(loop)

    def cost(free, member, memory=None):
        run = with_member(space.write(loop, free), member)
        return objective(evaluate(*run, gradient_memory=memory))

    descent = Descent(
        cost,
        *(member, member, DescentSettings(steps=15, learning_rate=0.3)),
        surrogate_loss=lambda free, member: cost(free, member, 60.0),
    )
    state = descent.start(space.read(loop))
    for reached, _ in descent.run(state):
        state = reached
    tuned = evaluate_jit(space.write(loop, state.chosen_free[0]), sea)
    assert sum(float(x) for x in objective.terms(tuned)["tracking"]) < 1.5


def test_a_lost_run_counts_for_more_than_a_poor_one_but_not_for_thousands():
    values = np.array([3.0, 10.0, 20.0, 1e6, np.nan, np.inf])
    wanted = np.array([3.0, 10.0, 10.0 * (1.0 + np.log(2.0)), 30.0, 30.0, 30.0])
    for scale in (0.01, 1.0, 100.0):
        found = saturate_cost(jnp.asarray(scale * values), 4.0 * scale)
        np.testing.assert_allclose(found, scale * wanted)
