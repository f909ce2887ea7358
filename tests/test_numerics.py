import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider.control.observer import FixedTimeObserver, observer_root
from jaxglider.core import numerics

DTYPES = [jnp.float32, jnp.float64]
NEWTON_STEPS = next(
    field.default
    for field in dataclasses.fields(FixedTimeObserver)
    if field.name == "newton_steps"
)

needs_long_double = pytest.mark.skipif(
    np.finfo(np.longdouble).eps > 1e-18, reason="long double is no longer than double"
)


def _angles(dtype):
    """All quadrants, both sides of every seam, and magnitudes from 1e-30 to 1e4."""
    rng = np.random.default_rng(0)
    seams = np.arange(-6000, 6001) * (math.pi / 4)
    tiny = np.logspace(-30, 0, 200)
    parts = [seams, seams * (1 + 1e-7), np.linspace(-1e4, 1e4, 20001), tiny, -tiny]
    return np.concatenate([*parts, rng.uniform(-10, 10, 20000), [0.0]]).astype(dtype)


@needs_long_double
@pytest.mark.parametrize("dtype", DTYPES)
def test_sincos_and_its_derivatives_agree_with_long_double(dtype):
    x = _angles(dtype)
    sine, cosine = np.sin(x.astype(np.longdouble)), np.cos(x.astype(np.longdouble))

    def everything(angle):
        one = jnp.ones_like(angle)

        def slope(a):
            return jax.jvp(numerics.sincos, (a,), (one,))[1]

        return (
            numerics.sincos(angle),
            slope(angle),
            jax.jvp(slope, (angle,), (one,))[1],
            jax.grad(lambda a: numerics.sincos(a)[0])(angle),
        )

    value, first, second, reverse = jax.jit(jax.vmap(everything))(x)
    assert value[0].dtype == value[1].dtype == dtype
    pairs = zip(
        [*value, *first, *second, reverse],
        [sine, cosine, cosine, -sine, -sine, -cosine, cosine],
        strict=True,
    )
    for got, wanted in pairs:
        error = np.abs(np.asarray(got).astype(np.longdouble) - wanted)
        assert error.max() <= 2.0 * np.finfo(dtype).eps


def test_sincos_of_what_is_not_finite_is_not_a_number():
    for bad in (jnp.nan, jnp.inf, -jnp.inf):
        assert all(np.isnan(v) for v in numerics.sincos(jnp.asarray(bad)))


@pytest.mark.parametrize("dtype", DTYPES)
def test_once_is_the_identity_in_value_and_in_both_modes(dtype):
    x = jnp.asarray([-3.5, -0.0, 0.0, 1e-30, 7.0, 1e30], dtype)
    once, one = jax.vmap(numerics.barrier), jnp.ones_like(x)
    np.testing.assert_array_equal(jax.jit(once)(x), x)
    np.testing.assert_array_equal(jax.jvp(once, (x,), (one,))[1], one)
    np.testing.assert_array_equal(jax.vmap(jax.grad(numerics.barrier))(x), one)
    assert np.isnan(numerics.barrier(jnp.asarray(np.nan)))


FUNCTIONS = {
    # name: ours, NumPy's, its derivative, arguments, error in units of the last place
    "arctan": (
        numerics.arctan,
        np.arctan,
        lambda x, y: 1 / (1 + x * x),
        np.concatenate([-np.logspace(-12, 12, 4001), np.linspace(-3, 3, 4001)]),
        4.0,
    ),
    "log2": (
        numerics.log2,
        np.log2,
        lambda x, y: 1 / (x * np.log(np.longdouble(2))),
        np.concatenate([np.logspace(-30, 30, 8001), np.linspace(0.5, 2.0, 4001)]),
        2.0,
    ),
    "exp2": (
        numerics.exp2,
        np.exp2,
        lambda x, y: y * np.log(np.longdouble(2)),
        np.concatenate([np.linspace(-120, 120, 8001), np.linspace(-1, 1, 4001)]),
        2.0,
    ),
}


@needs_long_double
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_own_functions_and_their_slopes_agree_with_long_double(name, dtype):
    ours, theirs, slope, x, units = FUNCTIONS[name]
    x = x.astype(dtype)
    long = x.astype(np.longdouble)
    value, first = jax.device_get(jax.jit(jax.vmap(jax.value_and_grad(ours)))(x))
    assert value.dtype == first.dtype == dtype
    eps = np.finfo(dtype).eps
    wanted = theirs(long)
    # log2 near 1 is right to the rounding of the exponent it is a part of.
    scale = np.maximum(np.abs(wanted), 1.0 if name == "log2" else 1e-30)
    assert np.max(np.abs(value - wanted) / scale) <= units * eps
    wanted = slope(long, wanted)
    assert np.max(np.abs(first - wanted) / np.abs(wanted)) <= (units + 2.0) * eps


@pytest.mark.parametrize("name", FUNCTIONS)
def test_own_functions_of_what_is_not_a_number_are_not_a_number(name):
    assert np.isnan(FUNCTIONS[name][0](jnp.asarray(np.nan)))


def test_exp2_stops_at_the_ends_of_the_normal_numbers():
    got = jax.vmap(numerics.exp2)(jnp.asarray([-1e4, 1e4], jnp.float32))
    np.testing.assert_array_equal(got, np.exp2(np.float32([-126.0, 126.0])))


EXPONENTS = (0.0, 0.4, 0.5, 1.0, 1.5, 2.0)
SMOOTHING = 1e-3


@jax.jit
def _powers(x):
    def one(x):
        dtype = x.dtype
        exponents = tuple(jnp.asarray(a, dtype) for a in EXPONENTS)
        smoothing = jnp.asarray(SMOOTHING, dtype)

        def all_of(x):
            return jnp.stack(numerics.signed_powers(x, exponents, smoothing))

        return jax.jvp(all_of, (x,), (jnp.ones_like(x),))

    return jax.vmap(one, out_axes=1)(x)


def test_signed_powers_are_odd():
    x = jnp.logspace(-12, 3, 61)
    value, slope = _powers(jnp.concatenate([x, -x]))
    np.testing.assert_array_equal(value[:, :61], -value[:, 61:])
    np.testing.assert_array_equal(slope[:, :61], slope[:, 61:])


def test_signed_powers_equal_their_formula():
    x = np.concatenate([-np.logspace(-12, 3, 61), [0.0], np.logspace(-12, 3, 61)])
    value, slope = _powers(jnp.asarray(x))
    for row, a in enumerate(EXPONENTS):
        size = np.hypot(x, SMOOTHING)
        np.testing.assert_allclose(value[row], x * size ** (a - 1), rtol=1e-13)
        wanted = size ** (a - 3) * (SMOOTHING**2 + a * x**2)
        # For a = 0 two terms of the size of the secant cancel.
        error = np.abs(slope[row] - wanted)
        assert np.all(error <= 1e-13 * size ** (a - 1))


def test_signed_powers_away_from_zero_are_the_unsmoothed_ones():
    x = np.concatenate([-np.logspace(-1, 3, 41), np.logspace(-1, 3, 41)])
    value, _ = _powers(jnp.asarray(x))
    for row, a in enumerate(EXPONENTS):
        sharp = np.abs(x) ** a * np.sign(x)
        allowed = (SMOOTHING / x) ** 2 * abs(a - 1) / 2 + 1e-14
        assert np.all(np.abs(value[row] / sharp - 1) <= allowed)


@pytest.mark.parametrize("dtype", DTYPES)
def test_signed_powers_have_the_slope_of_the_smoothing_at_zero(dtype):
    value, slope = _powers(jnp.zeros(1, dtype))
    assert value.dtype == slope.dtype == dtype
    np.testing.assert_array_equal(value, 0.0)
    wanted = [SMOOTHING ** (a - 1) for a in EXPONENTS]
    np.testing.assert_allclose(slope[:, 0], wanted, rtol=20 * np.finfo(dtype).eps)


def test_signed_power_varies_with_its_exponent_as_finite_differences_say():
    x, delta = jnp.asarray(-0.02), jnp.asarray(SMOOTHING)

    def of_exponent(a):
        return numerics.signed_powers(x, (a,), delta)[0]

    a, h = jnp.asarray(0.6), 1e-5
    central = (of_exponent(a + h) - of_exponent(a - h)) / (2 * h)
    np.testing.assert_allclose(jax.grad(of_exponent)(a), central, rtol=1e-8)
    at_zero = jax.grad(lambda a: numerics.signed_powers(0.0 * x, (a,), delta)[0])(a)
    assert float(at_zero) == 0.0


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_square_root_is_the_native_one_but_for_its_slope_at_zero(dtype):
    x = jnp.asarray([1e-30, 1e-3, 0.3, 2.0, 1e20], dtype)
    np.testing.assert_array_equal(jax.vmap(numerics.square_root)(x), jnp.sqrt(x))
    slope = jax.vmap(jax.grad(numerics.square_root))
    np.testing.assert_array_equal(slope(x), jax.vmap(jax.grad(jnp.sqrt))(x))
    zero = jnp.zeros((), dtype)
    assert jax.grad(numerics.square_root)(zero) == 0.0
    assert jax.jacfwd(numerics.square_root)(zero) == 0.0
    # The middle of the one-sided slopes of |x|, -1 and 1; the native one gives NaN.
    assert jax.grad(lambda y: numerics.square_root(y * y))(zero) == 0.0
    assert np.isnan(numerics.square_root(-zero - 1.0))


def test_saturate_clips_both_ways_and_passes_slopes_only_inside():
    x = jnp.array([-5.0, -0.39, 0.0, 0.39, 5.0])
    limit = jnp.asarray(0.4)
    value, slope = jax.vmap(jax.value_and_grad(lambda x: numerics.saturate(x, limit)))(
        x
    )
    np.testing.assert_array_equal(value, [-0.4, -0.39, 0.0, 0.39, 0.4])
    np.testing.assert_array_equal(slope, [0.0, 1.0, 1.0, 1.0, 0.0])


def test_select_takes_the_indexed_value_and_the_last_past_the_end():
    values = jnp.asarray([3.0, 1.0, 4.0, 1.5])
    index = jnp.arange(6)
    chosen, slopes = jax.jit(
        jax.vmap(jax.value_and_grad(lambda v, i: numerics.select(i, v)), (None, 0))
    )(values, index)
    np.testing.assert_array_equal(chosen, [3.0, 1.0, 4.0, 1.5, 1.5, 1.5])
    np.testing.assert_array_equal(slopes, np.eye(4)[[0, 1, 2, 3, 3, 3]])


def _left_side(y, a1, a2, stretch, smoothing):
    size = np.hypot(y, smoothing)
    phi1 = y * size**-0.5 + stretch * y * size**0.5
    phi2 = 0.5 * y / size + 2 * stretch * y + 1.5 * stretch**2 * y * size
    return y + a1 * phi1 + a2 * phi2


def _by_bisection(left_side, target):
    low, high = np.minimum(target, 0.0), np.maximum(target, 0.0)
    for _ in range(1200):
        middle = 0.5 * (low + high)
        below = left_side(middle) < target
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def _observer_problems():
    """Targets, and gains from a tenth of the paper's to ten times them."""
    rng = np.random.default_rng(1)
    paper = np.array([[0.001, 0.01, 18.0], [0.01, 0.1, 18.0], [0.01, 0.1, 180.0]])
    corner = np.stack(np.meshgrid(*([[0.1, 1.0, 10.0]] * 3)), -1).reshape(-1, 3)
    factor = np.concatenate([corner, 10 ** rng.uniform(-1, 1, (23, 3))])
    gains = (paper[:, None] * factor).reshape(-1, 3)
    dt = np.array([0.01, 0.05, 0.1])
    size = np.logspace(-8, 3, 34)
    target = np.concatenate([-size, [0.0], size])
    case, dt, target = (
        axis.ravel()
        for axis in np.meshgrid(np.arange(len(gains)), dt, target, indexing="ij")
    )
    iota1, iota2, stretch = gains[case].T
    return target, (dt * iota1, dt**2 * iota2, stretch, np.full_like(dt, 1e-3))


@jax.jit
def _observer_roots(target, gains):
    def one(target, gains):
        root = lambda b, g: observer_root(b, g, NEWTON_STEPS)
        return root(target, gains), jax.grad(root, (0, 1))(target, gains)

    return jax.vmap(one)(target, gains)


def test_observer_root_meets_its_equation_over_the_whole_tuning_range():
    target, gains = _observer_problems()
    root, _ = _observer_roots(target, gains)
    root = np.asarray(root)
    residual = np.abs(_left_side(root, *gains) - target)
    assert np.all(residual <= 1e-12 * np.abs(target))
    exact = _by_bisection(lambda y: _left_side(y, *gains), target)
    np.testing.assert_allclose(root, exact, rtol=1e-12, atol=0)


def _far_observer_problems():
    """Gains up to six decades from the paper's, and targets near the half sign."""
    rng = np.random.default_rng(5)
    count = 60_000
    decades = lambda: 10.0 ** rng.uniform(-6, 6, count)
    iota1 = decades() * rng.choice([0.001, 0.01], count)
    iota2 = decades() * rng.choice([0.01, 0.1], count)
    stretch = decades() * rng.choice([18.0, 180.0], count)
    dt = rng.choice([0.01, 0.05, 0.1], count)
    target = 10.0 ** rng.uniform(-8, 4, count)
    # The half sign: b = a2/2, where the root is steepest.
    near = 0.5 * dt**2 * iota2 * (1 + rng.choice([-1, 1], count) * decades() * 1e-6)
    close = (rng.random(count) < 0.3) & (near > 1e-8) & (near < 1e4)
    target = np.where(close, near, target)
    # Shipped: 26 % wrong at b = 3 with four steps from the old guess.
    iota1[0], iota2[0], stretch[0], dt[0], target[0] = 1310.4, 0.1, 18.0, 0.05, 3.0
    return target, (dt * iota1, dt**2 * iota2, stretch, np.full(count, 1e-3))


def test_observer_root_meets_its_equation_wherever_a_search_may_lead():
    target, gains = _far_observer_problems()
    one = lambda b, g: observer_root(b, g, NEWTON_STEPS)
    root = np.asarray(jax.jit(jax.vmap(one))(target, gains))
    # Bisection of the logarithm: roots span thirty decades.
    low, high = np.full(target.shape, -120.0), np.log(target)
    for _ in range(64):
        middle = 0.5 * (low + high)
        below = _left_side(np.exp(middle), *gains) < target
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    np.testing.assert_allclose(root, np.exp(0.5 * (low + high)), rtol=2e-9, atol=0)


def test_observer_root_in_single_precision_is_right_to_rounding():
    target, gains = jax.tree.map(lambda x: x.astype(np.float32), _observer_problems())
    one = lambda b, g: observer_root(b, g, NEWTON_STEPS)
    root = jax.jit(jax.vmap(one))(target, gains)
    assert root.dtype == np.float32
    gains = tuple(g.astype(float) for g in gains)
    exact = _by_bisection(lambda y: _left_side(y, *gains), target.astype(float))
    np.testing.assert_allclose(root, exact, rtol=6e-7, atol=0)


def test_observer_root_has_the_derivative_of_the_exact_root():
    target, gains = _observer_problems()
    keep = np.flatnonzero(target)[::7]
    arguments = [target[keep], *(g[keep] for g in gains)]
    _, (by_target, by_gains) = _observer_roots(arguments[0], tuple(arguments[1:]))
    for number, got in enumerate([by_target, *by_gains]):
        step = 1e-6 * np.abs(arguments[number])
        ends = []
        for sign in (1, -1):
            moved = list(arguments)
            moved[number] = arguments[number] + sign * step
            ends.append(
                _by_bisection(lambda y, p=moved[1:]: _left_side(y, *p), moved[0])
            )
        # A root known to rounding limits how small a relative change can be seen.
        scale = 1e-9 * np.abs(ends[0]) / np.abs(arguments[number])
        error = np.abs(np.asarray(got) - (ends[0] - ends[1]) / (2 * step))
        assert np.all(error <= 1e-6 * np.abs(np.asarray(got)) + scale), number


def test_solve_symmetric_agrees_with_linalg():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(200, 3, 3))
    matrix = root @ root.transpose(0, 2, 1) + 0.05 * np.eye(3)
    right = rng.normal(size=(200, 3))
    diagonal = tuple(matrix[:, i, i] for i in range(3))
    off = (matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2])
    got = jax.jit(jax.vmap(numerics.solve_symmetric))(diagonal, off, tuple(right.T))
    wanted = np.linalg.solve(matrix, right[..., None])[..., 0]
    error = np.linalg.norm(np.stack(got, -1) - wanted, axis=-1)
    condition = np.linalg.cond(matrix)
    assert np.all(error <= 1e-14 * condition * np.linalg.norm(wanted, axis=-1))
