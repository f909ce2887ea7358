import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider.control.prescribed.performance import Bound, unbounded
from jaxglider.control.prescribed.transform import ErrorTransformation

SHAPES = np.array([[1.0, 1.0], [0.3, 1.0], [0.8, 0.25]])
TAIL = 0.95


def _bound(width, rate=0.0, acceleration=0.0):
    width, rate, acceleration = (jnp.asarray(v) for v in (width, rate, acceleration))
    return Bound(width, rate, acceleration, jnp.asarray(False))


def _transformed(shape, error, error_rate, bound):
    return ErrorTransformation(shape[0], shape[1], TAIL)(error, error_rate, bound)


def _error(t):
    return 0.2 * jnp.sin(0.9 * t + 0.4) * jnp.exp(-0.1 * t) + 0.02


def _width(t):
    return 0.4 + 0.9 * jnp.exp(-0.35 * t) + 0.05 * jnp.cos(t)


def _printed_value(shape, t):
    """The paper's eps, without tails."""
    x = _error(t) / _width(t)
    return 0.5 * jnp.log((shape[0] + x) / (shape[1] - x))


def _printed_gain(shape, t):
    e, p = _error(t), _width(t)
    return (1 / (2 * p)) * (1 / (shape[0] + e / p) + 1 / (shape[1] - e / p))


def _printed_offset(shape, t):
    e, p = _error(t), _width(t)
    e1, p1 = jax.grad(_error)(t), jax.grad(_width)(t)
    p2 = jax.grad(jax.grad(_width))(t)
    gain_rate = jax.grad(_printed_gain, 1)(shape, t)
    return (
        gain_rate * (e1 * p - e * p1) / p
        + _printed_gain(shape, t) * (-e1 * p1 * p - e * p2 * p + e * p1**2) / p**2
    )


@pytest.fixture(scope="module")
def trajectory():
    """Ours and the print along a smooth trajectory, one row for each shape."""

    def one(shape, t):
        e1 = jax.grad(_error)
        p1 = jax.grad(_width)
        bound = Bound(_width(t), p1(t), jax.grad(p1)(t), jnp.asarray(False))
        ours = _transformed(shape, _error(t), e1(t), bound)
        rate = jax.grad(_printed_value, 1)
        printed = {
            "share": _error(t) / _width(t),
            "value": _printed_value(shape, t),
            "rate": rate(shape, t),
            "acceleration": jax.grad(rate, 1)(shape, t),
            "gain": _printed_gain(shape, t),
            "offset": _printed_offset(shape, t),
            "inverse_rate": jax.grad(lambda s: 1 / _printed_gain(shape, s))(t),
            "error_acceleration": jax.grad(e1)(t),
        }
        return ours, printed

    times = jnp.linspace(0.0, 12.0, 200)
    over_times = jax.vmap(one, (None, 0))
    ours, printed = jax.jit(jax.vmap(over_times, (0, None)))(SHAPES, times)
    share = np.asarray(printed["share"])
    inside = (share > -TAIL * SHAPES[:, :1]) & (share < TAIL * SHAPES[:, 1:])
    assert np.all(inside.sum(1) > 100)
    return jax.tree.map(lambda x: np.asarray(x)[inside], (ours, printed))


def test_gain_is_the_papers_print(trajectory):
    ours, printed = trajectory
    np.testing.assert_allclose(ours.gain, printed["gain"], rtol=1e-13)


def test_offset_is_the_papers_print(trajectory):
    ours, printed = trajectory
    scale = np.max(np.abs(printed["offset"]))
    np.testing.assert_allclose(ours.offset, printed["offset"], atol=1e-13 * scale)


def test_value_and_rate_are_the_papers_along_a_trajectory(trajectory):
    ours, printed = trajectory
    np.testing.assert_allclose(ours.value, printed["value"], atol=1e-14)
    np.testing.assert_allclose(ours.rate, printed["rate"], atol=1e-13)


def test_second_derivative_is_offset_plus_gain_times_error_acceleration(trajectory):
    ours, printed = trajectory
    got = ours.offset + ours.gain * printed["error_acceleration"]
    scale = np.max(np.abs(printed["acceleration"]))
    np.testing.assert_allclose(got, printed["acceleration"], atol=1e-13 * scale)


def test_gain_inverse_rate_is_the_rate_of_one_over_gain(trajectory):
    ours, printed = trajectory
    np.testing.assert_allclose(
        ours.gain_inverse_rate, printed["inverse_rate"], atol=1e-14
    )


def test_offset_agrees_with_finite_differences_of_the_print():
    shape, h = jnp.asarray(SHAPES[2]), 1e-4
    times = jnp.linspace(5.0, 7.0, 20)

    def ours(t):
        e1, p1 = jax.grad(_error), jax.grad(_width)
        bound = Bound(_width(t), p1(t), jax.grad(p1)(t), jnp.asarray(False))
        out = _transformed(shape, _error(t), e1(t), bound)
        return out.rate, out.offset + out.gain * jax.grad(e1)(t)

    rate, acceleration = jax.jit(jax.vmap(ours))(times)
    left, middle, right = (
        np.asarray(_printed_value(shape, times + k * h)) for k in (-1, 0, 1)
    )
    np.testing.assert_allclose(rate, (right - left) / (2 * h), atol=1e-7)
    second = (right - 2 * middle + left) / h**2
    np.testing.assert_allclose(acceleration, second, atol=1e-6)


@jax.jit
def _over_errors(shape, errors, width):
    """ε, its slope and curve in e, and what the transformation says of them."""

    def value(e):
        return _transformed(shape, e, jnp.zeros_like(e), _bound(width)).value

    def one(e):
        moving = _transformed(shape, e, jnp.asarray(0.7), _bound(width, -0.2, 0.1))
        still = _transformed(shape, e, jnp.asarray(0.7), _bound(width))
        return value(e), jax.grad(value)(e), jax.grad(jax.grad(value))(e), moving, still

    return jax.vmap(one)(errors)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_transformation_inverts_the_papers_s(shape):
    low, high = shape
    width = 0.6
    x = np.linspace(-TAIL * low, TAIL * high, 101)
    eps = np.asarray(_over_errors(shape, x * width, width)[0])
    back = (high * np.exp(eps) - low * np.exp(-eps)) / (np.exp(eps) + np.exp(-eps))
    np.testing.assert_allclose(back, x, atol=5e-16 * 4)
    assert np.all(np.diff(eps) > 0.0)
    zero = _over_errors(shape, np.zeros(1), width)[0]
    np.testing.assert_allclose(zero, 0.5 * np.log(low / high), atol=1e-16)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_tails_continue_value_and_slope_as_a_straight_line(shape):
    low, high = shape
    width = 0.6
    for edge in (-TAIL * low, TAIL * high):
        share = np.array([1 - 1e-9, 1.0, 1 + 1e-9, 1.02, 3.0, 1e6])
        value, slope, curve, moving, still = _over_errors(
            shape, edge * share * width, width
        )
        at_edge = 0.5 * np.log((low + edge) / (high - edge))
        steep = 0.5 * (1 / (low + edge) + 1 / (high - edge))
        line = at_edge + steep * edge * (share - 1)
        np.testing.assert_allclose(value, line, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(slope, steep / width, rtol=2e-8)
        np.testing.assert_array_equal(curve[2:], 0.0)
        np.testing.assert_allclose(moving.gain, slope, rtol=1e-14)
        # With a straight T and P at rest nothing is left of the offset.
        np.testing.assert_array_equal(still.offset[2:], 0.0)
        np.testing.assert_allclose(still.rate[2:], 0.7 * steep / width, rtol=1e-13)
        # On the line ε = m x + c, so the moving funnel adds m times x'' without e''.
        e, p1, p2 = edge * share[2:] * width, -0.2, 0.1
        x_curve = -2 * 0.7 * p1 / width**2 - e * p2 / width**2
        x_curve += 2 * e * p1**2 / width**3
        np.testing.assert_allclose(moving.offset[2:], steep * x_curve, rtol=1e-12)
        np.testing.assert_allclose(moving.gain_inverse_rate[2:], p1 / steep, rtol=1e-12)


def test_slope_in_the_error_is_the_gain_inside_too():
    shape = SHAPES[1]
    errors = np.linspace(-0.28, 0.94, 50) * 0.6
    _, slope, *_, moving, _ = _over_errors(shape, errors, 0.6)
    np.testing.assert_allclose(slope, moving.gain, rtol=1e-13)


def test_an_infinitely_wide_funnel_leaves_the_middle_of_the_transformation():
    out = ErrorTransformation()(
        jnp.asarray(5.0), jnp.asarray(-2.0), unbounded(jnp.asarray(0.0))
    )
    for value in (out.value, out.rate, out.offset, out.gain):
        assert float(value) == 0.0


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_transformation_keeps_the_precision_of_its_arguments(dtype):
    numbers = [jnp.asarray(v, dtype) for v in (0.9, 0.8, 0.95, 0.1, 0.2, 0.5, -0.1)]
    transformation = ErrorTransformation(*numbers[:3])
    bound = Bound(numbers[5], numbers[6], numbers[4], jnp.asarray(False))
    out = transformation(numbers[3], numbers[4], bound)
    assert {leaf.dtype for leaf in jax.tree.leaves(out)} == {jnp.dtype(dtype)}


@pytest.mark.parametrize(
    ("name", "bad", "rule"),
    [
        ("lower", 0.0, r"in \(0, 1\]"),
        ("lower", 1.1, r"in \(0, 1\]"),
        ("upper", -0.5, r"in \(0, 1\]"),
        ("upper", float("nan"), r"in \(0, 1\]|finite"),
        ("tail", 1.0, r"in \(0, 1\)"),
        ("tail", 0.0, r"in \(0, 1\)"),
    ],
)
def test_numbers_outside_their_interval_are_refused(name, bad, rule):
    with pytest.raises(
        ValueError, match=rf"ErrorTransformation\.{name} must be ({rule})"
    ):
        ErrorTransformation(**{name: bad})
