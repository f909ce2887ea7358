"""Estimators on a yo by script, against formulas, and through spoilt readings."""

import dataclasses
import functools
import math
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
from jax import lax
from scipy import optimize

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import bench_estimators as bench

from jaxglider.environment.surface import DIAMETER
from jaxglider.navigation.catalogue import ESTIMATORS, make_estimator
from jaxglider.navigation.estimator import Moves
from jaxglider.navigation.fixed_time import FixedTimeStateObserver, correction_root
from jaxglider.navigation.kalman import STATES
from jaxglider.navigation.linear import LinearObserver
from jaxglider.navigation.sensing.readings import Sensed
from jaxglider.signals import Command, GliderState, depth_rate

NAMES = [name for name in ESTIMATORS if name != "perfect"]
LANES = 16


@pytest.fixture(scope="module")
def flight():
    return jax.jit(bench.fly)()


@pytest.fixture(scope="module")
def shown(flight):
    keys = jr.split(jr.key(3), LANES)
    return bench.readings_of(bench.sensors(4.0), flight, keys, bench.TICK)


@pytest.fixture(scope="module")
def known(flight):
    """Estimates of an estimator from readings; one program for each kind."""

    def run(name, readings, factor=1.0, change=lambda estimator: estimator):
        model = bench.design_model(factor)
        estimator = make_estimator(name, model, bench.sensors(4.0), bench.STEPS)
        return bench.estimates_of(change(estimator), flight, readings, bench.TICK)

    return run


@pytest.mark.parametrize(
    ("name", "factor", "steady", "after"),
    [
        ("model-aided", 1.0, 0.25, 0.3),
        ("model-aided", 0.8, 0.25, 0.5),
        ("model-aided", 1.2, 0.25, 0.4),
        ("fixed-time", 1.0, 0.9, 6.0),
        ("linear", 1.0, 1.2, 4.8),
    ],
)
def test_depth_rate_is_known_on_a_yo(flight, shown, known, name, factor, steady, after):
    errors = bench.rate_errors(known(name, shown, factor), flight)
    figures = bench.steady_and_after(errors, bench.TICK)
    assert 100.0 * figures[0] <= steady, figures
    assert 100.0 * figures[1] <= after, figures


@pytest.mark.parametrize("name", NAMES)
def test_sensors_that_are_dead_stuck_or_wild_do_no_lasting_harm(
    flight, shown, known, name
):
    rng, ticks = np.random.default_rng(1), bench.HALVES * round(bench.HALF / 4.0)
    count = (LANES, ticks)

    def spoilt(reading):
        value = np.asarray(reading.value).copy()
        kind = rng.integers(0, 12, count)
        kind[:, 3 * ticks // 4 :] = 11
        # A spell of one fault, not a mixture: sensors stick, and stay wild.
        kind = np.repeat(kind[:, ::8], 8, axis=1)[:, :ticks]
        value = np.where(kind == 0, np.nan, value)
        value = np.where(kind == 1, np.inf, value)
        value = np.where(kind == 2, 1e6 * rng.standard_normal(count), value)
        value = np.where(kind == 3, value[:, :1], value)
        value = np.where(kind == 4, value + 40.0, value)
        fresh = np.asarray(reading.fresh) & (kind != 5)
        return eqx.tree_at(
            lambda at: (at.value, at.fresh),
            reading,
            (jnp.asarray(value), jnp.asarray(fresh)),
        )

    readings = tuple(spoilt(reading) for reading in shown.sensed.fields())
    after = known(name, eqx.tree_at(lambda at: at.sensed.fields(), shown, readings))
    clean = known(name, shown)
    for part in jax.tree.leaves(after):
        assert np.all(np.isfinite(part))
    late = slice(-ticks // 8, None)
    for field, limit in (("depth", 0.5), ("pitch", 0.05), ("heading", 0.15)):
        truth = np.asarray(getattr(flight.state, field))[1:][late]
        error = np.asarray(getattr(after, field))[:, late] - truth
        if field == "heading":
            error = (error + math.pi) % (2.0 * math.pi) - math.pi
        assert math.sqrt((error**2).mean()) < limit, field
    errors = [bench.rate_errors(run, flight)[:, late] for run in (after, clean)]
    rms = [math.sqrt((e**2).mean()) for e in errors]
    assert rms[0] < 1.5 * rms[1] + 0.002


@pytest.fixture(scope="module")
def followed():
    """Estimates of the model-aided filter from any belief; one program."""
    estimator = make_estimator(
        "model-aided", bench.design_model(1.0), bench.sensors(4.0), bench.STEPS
    )
    estimator = dataclasses.replace(estimator, zero=jnp.asarray(0.3))

    @jax.jit
    def run(belief, readings, held):
        def tick(state, row):
            shown, command = row
            truth = estimator.estimate(state)
            moves = Moves(command, command)
            state = estimator.step(state, shown, moves, truth, jnp.asarray(4.0))
            return state, estimator.estimate(state)

        return lax.scan(tick, belief, (readings, held))

    return estimator, run


def test_a_filter_that_turns_once_from_sample_to_sample_begins_again(
    flight, shown, followed
):
    """It hits every heading with all the rest wrong, and so it stays, unless told."""
    estimator, run = followed
    ticks = 40

    def part(begin):
        readings = jax.tree.map(lambda x: x[0, begin : begin + ticks], shown)
        after = slice(begin + 1, begin + ticks + 1)
        return readings, jax.tree.map(lambda x: x[after], flight.held)

    begun = estimator.init(jax.tree.map(lambda x: x[0], flight.state))
    belief, _ = run(begun, *part(0))
    wrong = {"surge": -0.1, "heave": 0.1, "yaw_rate": -2.0 * math.pi / 4.0}
    mean = belief.mean
    for name, value in wrong.items():
        mean = mean.at[STATES.index(name)].set(value)
    _, after = run(dataclasses.replace(belief, mean=mean), *part(ticks))
    truth = jax.tree.map(lambda x: x[2 * ticks], flight.state)
    for name in wrong:
        error = float(getattr(after, name)[-1] - getattr(truth, name))
        assert abs(error) < 0.02, name


@pytest.mark.parametrize("zero", [-0.5, 0.5])
def test_a_floating_hull_tells_the_zero_of_its_depth_sensor(shown, followed, zero):
    estimator, run = followed
    ticks, ballast = 40, -0.2
    weight = estimator.model.parameters.surge_mass
    # What it is too light by hangs out of the water: s² (3 − 2 s) m = 0.2 kg.
    out = optimize.brentq(lambda s: s * s * (3.0 - 2.0 * s) * weight + ballast, 0, 1)
    depth = -out * DIAMETER
    first = jax.tree.map(lambda x: x[0, :ticks], shown)
    values = (depth + zero, 0.0, 0.0, 0.3)
    readings = eqx.tree_at(
        lambda at: [x.value for x in at.sensed.fields()],
        first,
        [jnp.full(ticks, x) for x in values],
    )
    held = Command(*(jnp.full(ticks, x) for x in (ballast, 0.0, 0.0)))
    begun = estimator.init(GliderState.at_rest(depth=depth, heading=0.3))
    late = np.asarray(run(begun, readings, held)[1].depth)[-10:]
    np.testing.assert_allclose(late, depth, atol=0.05, rtol=0.0)


def test_poles_of_the_linear_observer_are_where_its_formula_puts_them():
    for omega, period in ((0.2, 4.0), (1.0, 0.5), (0.05, 20.0)):
        four = Sensed(omega, omega, omega, omega)
        observer = LinearObserver(bench.design_model(), bandwidth=four)
        one = Sensed(1.0, 1.0, 1.0, 1.0)
        intervals = Sensed(*(jnp.asarray(period),) * 4)
        gains = observer.corrections(one, intervals).depth
        gain = np.array([[float(x)] for x in gains])
        ahead = np.array([[1, period, period**2 / 2], [0, 1, period], [0, 0, 1]])
        error = (np.eye(3) - gain @ np.array([[1.0, 0.0, 0.0]])) @ ahead
        pole = math.exp(-omega * period)
        wanted = np.poly([pole] * 3)
        np.testing.assert_allclose(np.poly(error), wanted, atol=1e-9)


def powers(e, near, far, low, high, t, smoothing=1e-3):
    """T φ₁, T² φ₂, T³ φ₃ in NumPy."""
    size = np.hypot(e, smoothing)
    total = []
    for i, binomial in ((1, 3), (2, 3), (3, 1)):
        k, kappa = binomial * near**i, binomial * far**i
        a, b = i * low - (i - 1), i * high - (i - 1)
        total.append(t**i * e * (k * size ** (a - 1) + kappa * size ** (b - 1)))
    return np.array(total)


@jax.jit
def roots(b, gains):
    """Roots and their slopes."""
    return jax.vmap(jax.value_and_grad(lambda x: correction_root(x, gains)))(b)


@pytest.mark.parametrize("t", [0.02, 4.0, 20.0])
def test_the_implicit_step_solves_its_equation(t):
    b = np.concatenate(
        [-np.geomspace(1e-7, 1e3, 60), [0.0], np.geomspace(1e-7, 1e3, 60)]
    )
    gains = tuple(jnp.asarray(x) for x in (0.12 * t, 0.3 * t, 0.85, 1.2, 1e-3))
    step = 1e-6 * np.maximum(np.abs(b), 1e-4)
    root, slope = map(np.asarray, roots(jnp.asarray(b), gains))
    left = root + powers(root, 0.12, 0.3, 0.85, 1.2, t).sum(axis=0)
    np.testing.assert_allclose(left, b, rtol=1e-8, atol=1e-14)
    up, down = (np.asarray(roots(jnp.asarray(b + s), gains)[0]) for s in (step, -step))
    np.testing.assert_allclose(slope, (up - down) / (2 * step), rtol=1e-4)


@functools.lru_cache
def settling(kind, starts):
    """Times until the error stays below 5 mm, of errors that begin at some sizes."""
    four = Sensed(0.5, 0.5, 0.5, 0.5)
    model = bench.design_model()
    if kind == "linear":
        observer = LinearObserver(model, bandwidth=four)
    else:
        observer = FixedTimeStateObserver(model, near=four, far=four, low=0.8, high=1.2)
    period, ticks = 0.05, 6000
    ahead = jnp.array([[1, period, period**2 / 2], [0, 1, period], [0, 0, 1]])
    intervals = Sensed(*(jnp.asarray(period),) * 4)

    def tick(error, _):
        error = ahead @ error
        said = observer.corrections(Sensed(*(error[0],) * 4), intervals).depth
        error = error - jnp.stack(list(said))
        return error, jnp.abs(error[0])

    run = jax.jit(jax.vmap(lambda e: jax.lax.scan(tick, e, None, length=ticks)[1]))
    sizes = np.asarray(run(jnp.array([[s, 0.0, 0.0] for s in starts])))
    late = [np.flatnonzero(row > 5e-3) for row in sizes]
    return [period * (rows[-1] + 1) if rows.size else 0.0 for rows in late], observer


def test_the_fixed_time_observer_settles_within_its_bound_however_far_it_starts():
    starts = (1.0, 1e2, 1e4, 1e6)
    times, observer = settling("fixed-time", starts)
    bound = observer.settling_bound().depth
    assert max(times) <= bound
    # From 10⁴ times farther off it takes little longer; the linear one keeps adding.
    linear, _ = settling("linear", starts)
    assert times[3] - times[2] < 0.5 * (linear[3] - linear[2])
    assert times[3] < linear[3]


GAINS = {
    "model-aided": (
        *("acceleration", "turning", "mass_walk", "drag_walk", "moment_walk"),
        "noise",
    ),
    "fixed-time": ("near", "far", "low", "high"),
    "linear": ("bandwidth",),
}
RATES = "roll_rate", "pitch_rate", "yaw_rate"


@pytest.mark.parametrize("name", NAMES)
def test_gradients_of_gains_agree_with_differences(flight, shown, name):
    # Half of it before an inflection, half in it: no gain is without effect.
    short = jax.tree.map(lambda x: x[70:101], flight)
    readings = jax.tree.map(lambda x: x[0, 70:100], shown)
    estimator = make_estimator(name, bench.design_model(0.9), bench.sensors(4.0), 2)
    gains = {field: getattr(estimator, field) for field in GAINS[name]}
    leaves, form = jax.tree.flatten(gains)

    def loss(factors):
        changed = [x * factor for x, factor in zip(leaves, factors, strict=True)]
        moved = dataclasses.replace(estimator, **jax.tree.unflatten(form, changed))
        known = bench.estimated(moved, short, readings, bench.TICK)
        true = jax.tree.map(lambda x: x[1:], short.state)
        off = [jax.vmap(depth_rate)(known) - jax.vmap(depth_rate)(true)]
        off += [getattr(known, rate) - getattr(true, rate) for rate in RATES]
        return sum(1e4 * jnp.mean(x**2) for x in off)

    both = jax.jit(jax.value_and_grad(loss))
    ones, step = np.ones(len(leaves)), 1e-4
    _, gradient = both(jnp.asarray(ones))
    for n, found in enumerate(np.asarray(gradient)):
        aside = step * np.eye(len(leaves))[n]
        up, down = (float(both(jnp.asarray(ones + s))[0]) for s in (aside, -aside))
        assert found == pytest.approx((up - down) / (2 * step), rel=1e-5, abs=0), n
        assert found != 0.0
