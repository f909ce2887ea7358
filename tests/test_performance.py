import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider.control.prescribed.performance import (
    ExponentialFunction,
    HalfSechFunction,
    SechFunction,
    unbounded,
)

# P_0, P_inf, T: the paper's three channels and an early, a late and a flat one.
NUMBERS = {
    SechFunction: [(1.0, 0.2, 100.0), (0.87, 0.17, 80.0), (3.0, 0.05, 2.0)],
    HalfSechFunction: [(1.0, 0.2, 100.0), (0.87, 0.17, 80.0), (0.1, 0.05, 2.0)],
    ExponentialFunction: [(1.0, 0.2, 100.0), (1.5, 0.17, 80.0), (3.0, 0.05, 2.0)],
}
FORMS = list(NUMBERS)
LANES = 3072
each_form = pytest.mark.parametrize("form", FORMS, ids=lambda form: form.__name__)
CASES = [(form, numbers) for form in FORMS for numbers in NUMBERS[form]]
each_case = pytest.mark.parametrize(
    ("form", "numbers"), CASES, ids=[f"{f.__name__}-{n[2]:g}" for f, n in CASES]
)


def _sech(y):
    return 2.0 / (np.exp(y) + np.exp(-y))


def _falling_part(form, numbers, t):
    """The paper's print for t < T, less P_inf."""
    p0, _, duration = numbers
    z = duration / (duration - np.asarray(t, np.longdouble))
    if form is SechFunction:
        return _sech(_sech(np.longdouble(p0)) * z)
    if form is HalfSechFunction:
        y = np.exp(p0 * z)
        return y / (1 + y**2)
    return (p0 - t / np.longdouble(duration)) * np.exp(1 - z)


def _exponent_rate(form, numbers):
    """What z is multiplied by in the exponent."""
    p0 = numbers[0]
    return {SechFunction: 1 / math.cosh(p0), HalfSechFunction: p0}.get(form, 1.0)


def _evaluate(function, times):
    """The bound, and what automatic differentiation makes of P and P'."""
    padded = np.pad(times, (0, LANES - len(times)), mode="edge")
    return jax.tree.map(
        lambda x: np.asarray(x)[: len(times)], _evaluate_lanes(function, padded)
    )


@jax.jit
def _evaluate_lanes(function, times):

    def one(t):
        bound = function(t)
        slope, slope_of_function = jax.grad(lambda t, f: f(t).value, (0, 1))(
            t, function
        )
        rate_slope = jax.grad(lambda t: function(t).rate)(t)
        curve_slopes = jax.grad(lambda t, f: f(t).acceleration, (0, 1))(t, function)
        return bound, slope, rate_slope, slope_of_function, curve_slopes

    return jax.vmap(one)(times)


def _build(form, numbers, dtype=jnp.float64):
    return form(*(jnp.asarray(n, dtype) for n in numbers))


@each_case
def test_value_is_the_papers_print(form, numbers):
    duration = numbers[2]
    times = np.linspace(0.0, 0.995 * duration, 400)
    bound, *_ = _evaluate(_build(form, numbers), times)
    falling = _falling_part(form, numbers, times)
    np.testing.assert_allclose(bound.value - numbers[1], falling, atol=5e-16 * 4)
    # Relative accuracy where the falling part is still seen beside the final bound.
    seen = falling > 1e-3
    got = (np.asarray(bound.value) - numbers[1])[seen]
    np.testing.assert_allclose(got, falling[seen].astype(float), rtol=2e-12)


@pytest.mark.parametrize(
    ("form", "numbers", "wanted"),
    [
        (SechFunction, (1.0, 0.2, 100.0), lambda c: c(1 / c(1.0)) ** -1 + 0.2),
        (HalfSechFunction, (1.0, 0.2, 100.0), lambda c: 0.5 / c(1.0) + 0.2),
        (ExponentialFunction, (1.5, 0.2, 100.0), lambda c: 1.7),
    ],
)
def test_start_has_its_closed_form(form, numbers, wanted):
    value = form(*numbers)(jnp.asarray(0.0)).value
    np.testing.assert_allclose(value, wanted(math.cosh), rtol=1e-15)


@pytest.mark.parametrize(
    ("form", "p0", "wanted"),
    [
        (SechFunction, 1.0, 1 / math.cosh(2 / math.cosh(1.0)) + 0.2),
        (HalfSechFunction, 1.0, 0.5 / math.cosh(2.0) + 0.2),
        (ExponentialFunction, 1.5, math.exp(-1.0) + 0.2),
    ],
)
def test_half_time_has_its_closed_form(form, p0, wanted):
    value = form(p0, 0.2, 100.0)(jnp.asarray(50.0)).value
    np.testing.assert_allclose(value, wanted, rtol=1e-15)


@each_case
def test_bound_is_positive_and_falls_until_it_is_lost_in_rounding(form, numbers):
    duration = numbers[2]
    times = np.linspace(0.0, 1.5 * duration, 3001)
    bound, *_ = _evaluate(_build(form, numbers), times)
    value, rate = np.asarray(bound.value), np.asarray(bound.rate)
    assert np.all(value >= numbers[1])
    assert np.all(np.diff(value) <= 0.0)
    before = times < duration
    with np.errstate(over="ignore"):
        falling = _falling_part(form, numbers, times[before])
    visible = np.flatnonzero(falling > 1e-12)
    assert len(visible) > 1000
    assert np.all(np.diff(value[visible]) < 0.0)
    assert np.all(rate[visible] < 0.0)


@each_case
def test_bound_is_exactly_the_final_one_from_the_settling_time_on(form, numbers):
    duration = numbers[2]
    times = np.array([1.0, 1.0 + 1e-15, 1.001, 2.0, 1e6]) * duration
    bound, *_ = _evaluate(_build(form, numbers), times)
    np.testing.assert_array_equal(bound.value, numbers[1])
    np.testing.assert_array_equal(bound.rate, 0.0)
    np.testing.assert_array_equal(bound.acceleration, 0.0)
    assert np.all(bound.settled)
    just_before = _build(form, numbers)(jnp.asarray(duration * (1 - 1e-9)))
    assert not bool(just_before.settled)


@each_case
def test_rates_are_the_derivatives_of_the_value(form, numbers):
    duration = numbers[2]
    times = np.concatenate([np.linspace(0.0, 0.999, 500), [1.0, 1.3]]) * duration
    bound, slope, rate_slope, *_ = _evaluate(_build(form, numbers), times)
    np.testing.assert_allclose(bound.rate * duration, slope * duration, atol=1e-13)
    np.testing.assert_allclose(
        bound.acceleration * duration**2, rate_slope * duration**2, atol=1e-11
    )


@each_case
def test_rates_agree_with_central_differences_of_the_print(form, numbers):
    duration = numbers[2]
    times = np.linspace(0.01, 0.9, 200) * duration
    bound, *_ = _evaluate(_build(form, numbers), times)
    t, h = times.astype(np.longdouble), np.longdouble(1e-5 * duration)
    left, middle, right = (
        _falling_part(form, numbers, t + shift * h) for shift in (-1, 0, 1)
    )
    first = (right - left) / (2 * h)
    second = (right - 2 * middle + left) / h**2
    np.testing.assert_allclose(
        bound.rate * duration, (first * duration).astype(float), atol=1e-6
    )
    np.testing.assert_allclose(
        bound.acceleration * duration**2,
        (second * duration**2).astype(float),
        atol=1e-5,
    )


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@each_form
def test_value_and_gradients_pass_the_settling_time_without_a_trace(form, dtype):
    eps = float(np.finfo(dtype).eps)
    shares = [k * eps for k in range(-8, 9)]
    shares += [sign * 10.0**-k for k in range(2, 17) for sign in (-1, 1)]
    # Where the falling part is handed over to its limit, at z = 40 / slope.
    for numbers in NUMBERS[form]:
        limit = -_exponent_rate(form, numbers) / 40.0
        shares += [limit * (1 + k * 1e-6) for k in (-1000, -1, 0, 1, 1000)]
    for numbers in NUMBERS[form]:
        duration = numbers[2]
        times = (duration * (1.0 + np.array(shares))).astype(dtype)
        function = _build(form, numbers, dtype)
        bound, slope, rate_slope, by_numbers, curves = _evaluate(function, times)
        leaves = jax.tree.leaves((bound, slope, rate_slope, by_numbers, curves))
        floating = [x for x in leaves if jnp.issubdtype(x.dtype, jnp.floating)]
        assert all(x.dtype == dtype for x in floating)
        assert all(np.all(np.isfinite(x)) for x in floating)
        # Where the exponent is past 25 only the final bound is left.
        near = np.abs(times / duration - 1) < _exponent_rate(form, numbers) / 25
        np.testing.assert_allclose(bound.value[near], numbers[1], atol=1e-9, rtol=eps)
        np.testing.assert_allclose(slope[near] * duration, 0.0, atol=1e-5)
        np.testing.assert_array_equal(by_numbers.final_bound, 1.0)
        np.testing.assert_allclose(by_numbers.initial[near], 0.0, atol=1e-6)
        np.testing.assert_allclose(by_numbers.settling_time[near], 0.0, atol=1e-5)


@each_form
def test_single_precision_agrees_with_double(form):
    for numbers in NUMBERS[form]:
        times = (np.linspace(0.0, 0.99, 300) * numbers[2]).astype(np.float32)
        rough, *_ = _evaluate(_build(form, numbers, jnp.float32), times)
        fine, *_ = _evaluate(_build(form, numbers), times.astype(np.float64))
        np.testing.assert_allclose(rough.value, fine.value, atol=2e-5)
        for name, power in (("rate", 1), ("acceleration", 2)):
            scale = numbers[2] ** power
            wanted = np.asarray(getattr(fine, name)) * scale
            got = np.asarray(getattr(rough, name)) * scale
            assert np.max(np.abs(got - wanted)) <= 1e-4 * np.max(np.abs(wanted))


@each_form
def test_gradients_by_the_numbers_agree_with_finite_differences(form):
    numbers = NUMBERS[form][1]
    times = np.linspace(0.0, 0.9, 10) * numbers[2]
    _, _, _, by_numbers, _ = _evaluate(_build(form, numbers), times)
    for index, name in enumerate(("initial", "final_bound", "settling_time")):
        ends = []
        for sign in (1, -1):
            moved = np.array(numbers)
            moved[index] *= 1 + sign * 1e-5
            value = _falling_part(form, tuple(moved), times) + np.longdouble(moved[1])
            ends.append(value)
        central = (ends[0] - ends[1]) / (2e-5 * numbers[index])
        np.testing.assert_allclose(
            getattr(by_numbers, name), central.astype(float), atol=1e-7
        )


def test_a_final_bound_that_the_start_cannot_exceed_is_refused():
    top = 1.0 / math.cosh(1.0)
    SechFunction(1.0, top * 0.999, 100.0)
    for bad in (top * 1.001, 5.0):
        with pytest.raises(ValueError, match=r"SechFunction\.final_bound") as refusal:
            SechFunction(1.0, bad, 100.0)
        assert "sech(initial) > final_bound" in str(refusal.value)
        assert f"received {np.asarray(bad)}" in str(refusal.value)


def test_an_exponential_that_would_dip_under_its_final_bound_is_refused():
    ExponentialFunction(1.0, 0.2, 100.0)
    with pytest.raises(ValueError, match=r"initial must be at least 1; received 0\.99"):
        ExponentialFunction(0.99, 0.2, 100.0)


@each_form
@pytest.mark.parametrize("name", ["initial", "final_bound", "settling_time"])
@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_numbers_that_are_not_positive_are_refused_by_name(form, name, bad):
    numbers = dict(
        zip(("initial", "final_bound", "settling_time"), NUMBERS[form][0], strict=True)
    )
    with pytest.raises(ValueError, match=f"{form.__name__}.{name} must be"):
        form(**{**numbers, name: bad})


def test_an_unbounded_funnel_is_infinitely_wide_and_never_settles():
    bound = jax.jit(unbounded)(jnp.asarray(1e9))
    assert float(bound.value) == np.inf
    assert float(bound.rate) == float(bound.acceleration) == 0.0
    assert not bool(bound.settled)
