import math

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from jaxglider import paper
from jaxglider.core.batching import member_keys
from jaxglider.environment.disturbances import (
    AbstractDisturbance,
    Calm,
    Constant,
    GaussMarkov,
    ScaledDisturbance,
    Sinusoid,
    Sum,
    axes,
)
from jaxglider.signals import BodyAxes

KEY = jr.key(0)
TIMES = jnp.linspace(0.0, 300.0, 61)
DEVIATION = np.array([0.5, 1.0, 2.0, 0.25, 1.0, 3.0])
TAU = np.array([1.0, 2.0, 4.0, 1.0, 2.0, 4.0])
MEMBERS = 2500


class White(AbstractDisturbance):
    """Independent normal numbers."""

    def realise(self, key, times):
        return BodyAxes(*jr.normal(key, (6, len(times))))


def _rows(path):
    return np.stack(path.fields())


def test_calm_is_zero_everywhere():
    assert not _rows(Calm().realise(KEY, TIMES)).any()


def test_constant_is_the_same_at_all_times():
    force = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.3])
    path = _rows(Constant(axes(*force)).realise(KEY, TIMES))
    np.testing.assert_array_equal(path, np.repeat(force[:, None], 61, 1))


def test_the_papers_sea_has_the_printed_values():
    t = np.asarray(TIMES)
    slow, slower = np.sin(np.pi * t / 100), np.sin(2 * np.pi * t / 300)
    wanted = [
        0.02 * slow,
        0.01 * slow,
        -0.02 * slower,
        0.01 * slow,
        0.02 * slow,
        -0.01 * slow,
    ]
    path = _rows(paper.disturbance().realise(KEY, TIMES))
    np.testing.assert_allclose(path, wanted, atol=1e-16)
    # Spot values: t = 50 s is a quarter of the one period, t = 75 s of the other.
    assert path[0, 10] == pytest.approx(0.02)
    assert path[2, 15] == pytest.approx(-0.02)


def test_a_sinusoid_starts_at_its_phase():
    law = Sinusoid(axes(heave=2.0), axes(heave=0.3), axes(heave=math.pi / 6))
    path = law.realise(KEY, TIMES)
    assert float(path.heave[0]) == pytest.approx(1.0)
    np.testing.assert_allclose(
        path.heave, 2 * np.sin(0.3 * np.asarray(TIMES) + np.pi / 6), atol=1e-13
    )


def _noise():
    return GaussMarkov(axes(*DEVIATION), axes(*TAU))


@jax.jit
def _short_path(key):
    return _noise().realise(key, jnp.arange(6) * 0.3)


@pytest.fixture(scope="module")
def samples():
    """Sample paths at two ticks, [dt][axis, member, time], over the same 9 s."""

    @jax.jit
    def realise(keys, times):
        return jax.vmap(lambda key: _noise().realise(key, times))(keys)

    keys = member_keys(11, MEMBERS)
    return {
        dt: _rows(realise(keys, jnp.arange(round(9 / dt) + 1) * dt))
        for dt in (0.1, 0.5)
    }


@pytest.mark.parametrize("dt", [0.1, 0.5])
def test_noise_has_its_variance_at_every_time(samples, dt):
    path = samples[dt]
    for moment in (0.0, 1.0, 5.0, 9.0):
        deviation = path[:, :, round(moment / dt)].std(axis=1)
        # One standard error of a deviation from 2500 samples is 1.4 %.
        np.testing.assert_allclose(deviation, DEVIATION, rtol=0.05)
    np.testing.assert_allclose(
        path.mean(axis=1)[:, -1] / DEVIATION, 0.0, atol=4.5 / math.sqrt(MEMBERS)
    )


@pytest.mark.parametrize("dt", [0.1, 0.5])
def test_noise_forgets_exponentially_whatever_the_tick(samples, dt):
    path = samples[dt] / DEVIATION[:, None, None]
    for lag in (0.5, 1.0, 3.0):
        shift = round(lag / dt)
        # Pairs 6 s apart add samples that are nearly independent.
        pairs = [path[:, :, at] * path[:, :, at + shift] for at in (0, round(6.0 / dt))]
        correlation = np.mean(pairs, axis=(0, 2))
        np.testing.assert_allclose(correlation, np.exp(-lag / TAU), atol=0.06)


def test_noise_is_independent_between_axes(samples):
    correlation = np.corrcoef(samples[0.5][:, :, 7])
    np.testing.assert_allclose(correlation, np.eye(6), atol=4.5 / math.sqrt(MEMBERS))


def test_noise_is_gaussian(samples):
    scaled = samples[0.5][:, :, -1] / DEVIATION[:, None]
    shares = [np.mean(np.abs(scaled) < k) for k in (1.0, 2.0)]
    np.testing.assert_allclose(shares, [0.6827, 0.9545], atol=0.015)


def test_one_step_of_noise_is_the_exact_discretisation():
    # With the same normal draws the recursion of the docstring gives the same path.
    path = _rows(_short_path(KEY))
    for axis in range(6):
        draws = np.asarray(jr.normal(jr.fold_in(KEY, axis), (6,)))
        x = [DEVIATION[axis] * draws[0]]
        decay = np.exp(-0.3 / TAU[axis])
        for xi in draws[1:]:
            x.append(decay * x[-1] + DEVIATION[axis] * np.sqrt(1 - decay**2) * xi)
        np.testing.assert_allclose(path[axis], x, rtol=1e-12)


def test_equal_keys_give_equal_paths_and_other_members_other_ones():
    keys = member_keys(3, 2)
    first, again, other, elsewhere = (
        _rows(_short_path(key)) for key in (keys[0], keys[0], keys[1], jr.key(4))
    )
    np.testing.assert_array_equal(first, again)
    assert np.all(first != other)
    assert np.all(first != elsewhere)


def test_a_still_sea_of_noise_is_calm():
    law = GaussMarkov(BodyAxes(*(0.0,) * 6), BodyAxes(*(1.0,) * 6))
    assert not _rows(law.realise(KEY, TIMES)).any()


def test_the_terms_of_a_sum_draw_from_separate_keys():
    first, second, both = (
        _rows(Sum(terms).realise(KEY, TIMES))
        for terms in ((White(),), (Calm(), White()), (White(), White()))
    )
    assert np.all(first != second)
    np.testing.assert_allclose(both, first + second, rtol=1e-15)


def test_a_sum_adds_its_terms():
    a, b = Constant(axes(surge=1.0)), paper.disturbance()
    got = _rows(Sum((a, b, Calm())).realise(KEY, TIMES))
    wanted = _rows(a.realise(KEY, TIMES)) + _rows(b.realise(KEY, TIMES))
    np.testing.assert_allclose(got, wanted, rtol=1e-15)


@pytest.mark.parametrize(
    ("law", "rule"),
    [
        (
            lambda: GaussMarkov(axes(roll=-1.0), BodyAxes(*(1.0,) * 6)),
            r"standard_deviation\.roll must be zero or positive; received -1",
        ),
        (
            lambda: GaussMarkov(axes(), axes(1.0, 1.0, 1.0, 1.0, 1.0, 0.0)),
            r"correlation_time\.yaw must be positive; received 0",
        ),
        (lambda: Constant(axes(sway=float("nan"))), r"sway must be finite"),
    ],
)
def test_impossible_numbers_are_refused(law, rule):
    with pytest.raises(ValueError, match=rule):
        law()


def test_a_varied_sea_is_stronger_and_turned_about_the_vertical():
    sea = paper.disturbance()
    plain = _rows(sea.realise(KEY, TIMES))
    turned = _rows(ScaledDisturbance(sea, 1.5, 0.4).realise(KEY, TIMES))
    rotation = np.array(
        [[math.cos(0.4), -math.sin(0.4)], [math.sin(0.4), math.cos(0.4)]]
    )
    for pair in ([0, 1], [3, 4]):
        np.testing.assert_allclose(
            turned[pair], 1.5 * rotation @ plain[pair], atol=1e-15
        )
    np.testing.assert_allclose(turned[[2, 5]], 1.5 * plain[[2, 5]], atol=1e-15)
