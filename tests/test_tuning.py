"""Search space, objective and descent, on toys and on the paper's case."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import paper
from tuning.descent import Settings, descend, make_gradient
from tuning.objective import RelativeTracking
from tuning.space import FIXED_TIME_GAINS, PositiveGains, perturbed


@pytest.fixture(scope="module")
def loop():
    return paper.make_loop("switching", "printed", duration=20.0)


def test_free_numbers_round_trip_and_leave_the_rest_alone(loop):
    space = PositiveGains()
    free = space.read(loop.controller)
    np.testing.assert_allclose(np.exp(free), [0.001, 0.01, 0.01, 0.2, 0.001, 0.08])
    written = space.write(loop.controller, free + jnp.log(2.0))
    assert float(written.gains.heading.k2) == pytest.approx(0.16)
    assert float(written.gains.heading.rho) == 0.8
    np.testing.assert_allclose(space.read(written), free + jnp.log(2.0))


def test_no_free_number_makes_a_gain_negative(loop):
    space = PositiveGains()
    written = space.write(loop.controller, jnp.full(6, -300.0))
    assert float(written.gains.depth.k1) > 0.0


def test_a_controller_without_these_gains_is_refused(loop):
    smc = paper.make_controller("smc", "switching", loop.controller.model)
    with pytest.raises(ValueError, match=r"SMC lacks one of gains\.depth\.k1"):
        PositiveGains().read(smc)


def test_copies_are_centred_and_depend_on_the_key_alone():
    centre = jnp.arange(4.0)
    copies = perturbed(centre, jax.random.key(3), 5, 0.1)
    assert copies.shape == (10, 4)
    np.testing.assert_allclose(jnp.mean(copies, axis=0), centre, atol=1e-12)
    assert np.std(np.asarray(copies - centre)) == pytest.approx(0.1, rel=0.5)
    again = perturbed(centre, jax.random.key(3), 5, 0.1)
    np.testing.assert_array_equal(copies, again)


def test_objective_is_three_at_the_start_and_its_slope_is_right(loop, evaluate_jit):
    sea = loop.scenario.sea(jax.random.key(0))
    objective = RelativeTracking.of(evaluate_jit(loop, sea))
    space = PositiveGains()
    free = space.read(loop.controller)

    def loss(x):
        tried = eqx.tree_at(
            lambda at: at.controller, loop, space.write(loop.controller, x)
        )
        return objective(tried, sea)

    value, slope = jax.jit(jax.value_and_grad(loss))(free)
    assert float(value) == pytest.approx(3.0, abs=1e-12)
    direction = jnp.array([1.0, -0.5, 0.3, 0.7, -0.2, 0.4])
    along = jax.jit(lambda t: loss(free + t * direction))
    h = 1e-5
    difference = (along(h) - along(-h)) / (2 * h)
    np.testing.assert_allclose(jnp.dot(slope, direction), difference, rtol=1e-5)


def test_descent_finds_the_bottom_of_a_bowl():
    bowl = lambda x: jnp.sum((x - jnp.array([1.0, -2.0])) ** 2)
    settings = Settings(steps=200, learning_rate=0.1, pairs=2, spread=0.0)
    steps = list(descend(make_gradient(bowl, settings), jnp.zeros(2), settings))
    assert len(steps) == 201
    best = min(steps, key=lambda s: s.loss)
    np.testing.assert_allclose(best.free, [1.0, -2.0], atol=1e-2)
    assert [s.number for s in steps if s.best][-1] > 50


def test_a_step_into_nan_is_refused_and_the_next_is_shorter():
    """Descending 1/x towards larger x runs into a wall of NaN at x = 2."""
    wall = lambda x: jnp.where(x[0] < 2.0, 1.0 / x[0], jnp.nan)
    settings = Settings(steps=60, learning_rate=0.3, pairs=1, spread=0.0)
    gradient = make_gradient(wall, settings)
    steps = list(descend(gradient, jnp.ones(1), settings))
    refused = [s for s in steps if s.refused]
    assert refused
    assert all(not np.isfinite(s.loss) for s in refused)
    rates = [s.learning_rate for s in steps]
    assert rates[-1] == pytest.approx(0.3 * 0.5 ** len(refused), rel=1e-6) or (
        steps[-1].refused
    )
    kept = [s for s in steps if not s.refused]
    assert all(float(s.free[0]) < 2.0 for s in kept)
    assert min(s.loss for s in kept) < 0.52


def test_a_step_over_a_cliff_goes_back_to_the_best_gains():
    cliff = lambda x: jnp.where(x[0] < 1.0, 2.0 - x[0], 50.0 + 0.0 * x[0])
    settings = Settings(steps=12, learning_rate=0.4, pairs=1, spread=0.0)
    steps = list(descend(make_gradient(cliff, settings), jnp.zeros(1), settings))
    number = next(i for i, s in enumerate(steps) if s.refused)
    best = min((s for s in steps[:number]), key=lambda s: s.loss)
    following = steps[number + 1]
    assert abs(float(following.free[0] - best.free[0])) <= 0.2 + 1e-6


def test_one_wild_gradient_does_not_carry_the_mean_away():
    """A narrow spike of slope 1e6 in a gentle slope: clipped, it cannot dominate."""
    spiky = lambda x: x[0] + 1e-3 * jnp.sin(1e9 * x[0])
    settings = Settings(pairs=8, spread=0.1)
    _, slope = make_gradient(spiky, settings)(jnp.zeros(1), jax.random.key(0))
    assert abs(float(slope[0])) <= 1.0


def test_a_start_that_is_not_finite_is_said_so():
    settings = Settings(steps=1)
    gradient = make_gradient(lambda x: jnp.sum(x) * jnp.nan, settings)
    with pytest.raises(FloatingPointError, match="not finite at the starting gains"):
        next(iter(descend(gradient, jnp.zeros(2), settings)))


@pytest.mark.parametrize(
    "bad", [{"steps": 0}, {"learning_rate": -1.0}, {"pairs": 0}, {"worse": 1.0}]
)
def test_settings_out_of_range_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        Settings(**bad)


def test_tuning_the_paper_case_halves_the_objective(evaluate_jit):
    """The sum of the three relative errors goes from 3 to 1.5 or less in 30 steps."""
    loop = paper.make_loop("switching", "printed")
    sea = loop.scenario.sea(jax.random.key(0))
    objective = RelativeTracking.of(evaluate_jit(loop, sea))
    space = PositiveGains(FIXED_TIME_GAINS)

    def written(free):
        controller = space.write(loop.controller, free)
        return eqx.tree_at(lambda at: at.controller, loop, controller)

    settings = Settings(steps=30)
    gradient = make_gradient(lambda x: objective(written(x), sea), settings)
    steps = list(descend(gradient, space.read(loop.controller), settings))
    best = min((s for s in steps if not s.refused), key=lambda s: s.loss)
    channels = evaluate_jit(written(best.free), sea).channels
    ratios = [
        float(getattr(channels, c).rms_error / getattr(objective.start, c))
        for c in ("depth", "pitch", "heading")
    ]
    assert sum(ratios) < 1.5
    assert max(ratios) < 0.8
