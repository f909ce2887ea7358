"""Properties that must hold for every input, on the cheap maths."""

import jax
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import rotation_matrix

from jaxglider.control.observer import observer_root
from jaxglider.control.prescribed.performance import (
    Bound,
    ExponentialFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.control.prescribed.transform import ErrorTransformation
from jaxglider.core import numerics
from jaxglider.core import rotations as frames
from jaxglider.vehicle.actuators import Actuator

examples = settings(max_examples=60, deadline=None, derandomize=True)


def reals(low, high):
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


def magnitudes(low, high):
    """Numbers spread over decades."""
    return reals(np.log10(low), np.log10(high)).map(lambda power: 10.0**power)


angles = reals(-1e3, 1e3)
errors = st.one_of(reals(-3.0, 3.0), reals(-1e6, 1e6))

sincos = jax.jit(numerics.sincos)
wrap = jax.jit(frames.wrap)
rotation = jax.jit(rotation_matrix)
signed_power = jax.jit(lambda x, a, delta: numerics.signed_powers(x, (a,), delta)[0])
solve = jax.jit(numerics.solve_symmetric)
transform = jax.jit(
    lambda transformation, error, rate, width: transformation(
        error, rate, Bound(width, -0.1 * width, 0.02 * width, False)
    )
)
evaluate = jax.jit(lambda function, t: function(t))
follow = jax.jit(lambda actuator, held, wanted, dt: actuator.follow(held, wanted, dt))
root = jax.jit(observer_root, static_argnums=2)


@examples
@given(angles, angles)
def test_sincos_obeys_the_addition_theorems(a, b):
    (sa, ca), (sb, cb), (ss, cs) = (sincos(x) for x in (a, b, a + b))
    np.testing.assert_allclose(float(sa * sa + ca * ca), 1.0, atol=1e-15)
    # The sum is rounded to half a unit of 2000.
    np.testing.assert_allclose(float(ss), float(sa * cb + ca * sb), atol=5e-13)
    np.testing.assert_allclose(float(cs), float(ca * cb - sa * sb), atol=5e-13)


@examples
@given(angles)
def test_sine_is_odd_and_cosine_even(a):
    (s, c), (minus_s, minus_c) = sincos(a), sincos(-a)
    assert float(minus_s) == -float(s)
    assert float(minus_c) == float(c)


@examples
@given(st.one_of(angles, st.integers(-300, 300).map(lambda k: k * np.pi)))
def test_a_wrapped_angle_is_the_same_angle_within_one_turn(a):
    got = float(wrap(a))
    rounding = 2e-16 * (1.0 + abs(a))
    assert -np.pi - rounding <= got < np.pi + rounding
    turns = (a - got) / (2 * np.pi)
    np.testing.assert_allclose(turns, round(turns), atol=1e-12)
    np.testing.assert_allclose(float(wrap(got + 0.1)), wrap(a + 0.1), atol=2e-12)


@examples
@given(angles, reals(-1.57, 1.57), angles)
def test_rotations_keep_lengths_and_handedness(roll, pitch, heading):
    matrix = np.asarray(rotation(roll, pitch, heading))
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=2e-15)
    np.testing.assert_allclose(np.cross(matrix[0], matrix[1]), matrix[2], atol=2e-15)


@examples
@given(reals(-1e3, 1e3), reals(0.0, 3.0), magnitudes(1e-6, 1.0))
def test_signed_power_is_odd_and_keeps_the_sign(x, exponent, smoothing):
    value = float(signed_power(x, exponent, smoothing))
    assert float(signed_power(-x, exponent, smoothing)) == -value
    assert np.sign(value) == np.sign(x)


@examples
@given(reals(-1e3, 1e3), magnitudes(1e-9, 1e2), reals(0.0, 3.0), magnitudes(1e-4, 1.0))
def test_signed_power_never_falls(x, rise, exponent, smoothing):
    low = float(signed_power(x, exponent, smoothing))
    high = float(signed_power(x + rise, exponent, smoothing))
    assert high >= low - 1e-12 * abs(low)


@examples
@given(
    magnitudes(1e-2, 1e3), reals(0.0, 3.0), magnitudes(1e-6, 1.0), magnitudes(0.1, 10)
)
def test_signed_power_scales_with_its_unit(x, exponent, smoothing, unit):
    value = float(signed_power(unit * x, exponent, unit * smoothing))
    scaled = unit**exponent * float(signed_power(x, exponent, smoothing))
    np.testing.assert_allclose(value, scaled, rtol=1e-12)


@examples
@given(st.lists(reals(-2.0, 2.0), min_size=9, max_size=9), magnitudes(1e-2, 1e2))
def test_solve_symmetric_solves(entries, ridge):
    half = np.reshape(entries, (3, 3))
    matrix = half @ half.T + ridge * np.eye(3)
    right = half.sum(axis=0) + 1.0
    x = solve(
        tuple(np.diag(matrix)),
        (matrix[0, 1], matrix[0, 2], matrix[1, 2]),
        tuple(right),
    )
    error = np.linalg.norm(matrix @ np.array(x) - right)
    allowed = 1e-14 * np.linalg.cond(matrix) * np.linalg.norm(right)
    assert error <= allowed


@examples
@given(
    reals(-1e3, 1e3),
    st.tuples(
        magnitudes(1e-6, 1e-2),
        magnitudes(1e-7, 1e-3),
        magnitudes(1.0, 1e3),
        magnitudes(1e-4, 1e-2),
    ),
)
def test_the_observer_root_lies_between_zero_and_its_target_and_is_odd(target, gains):
    y = float(root(target, gains, 4))
    assert min(target, 0.0) <= y <= max(target, 0.0)
    assert float(root(-target, gains, 4)) == -y


@examples
@given(errors, reals(-1.0, 1.0), magnitudes(1e-2, 1e2), reals(0.01, 1), reals(0.01, 1))
def test_mirroring_error_and_bounds_mirrors_the_transformation(e, rate, p, low, high):
    right = transform(ErrorTransformation(low, high), e, rate, p)
    left = transform(ErrorTransformation(high, low), -e, -rate, p)
    for name, sign in (("value", -1), ("rate", -1), ("offset", -1), ("gain", 1)):
        wanted, got = float(getattr(right, name)), float(getattr(left, name))
        np.testing.assert_allclose(sign * got, wanted, rtol=1e-9, atol=1e-9)


@examples
@given(errors, magnitudes(1e-6, 1e3), reals(0.01, 1), reals(0.01, 1))
def test_the_transformed_error_rises_everywhere(e, rise, low, high):
    transformation = ErrorTransformation(low, high)
    here, there = (transform(transformation, x, 0.0, 1.0).value for x in (e, e + rise))
    # 1/(low + high) is the smallest slope of all.
    least = 2.0 / (low + high) * rise
    assert float(there) - float(here) >= 0.999 * least - 1e-9 * (1 + abs(e))


@examples
@given(
    st.sampled_from([SechFunction, HalfSechFunction, ExponentialFunction]),
    reals(1.0, 3.0),
    magnitudes(1e-3, 0.09),
    magnitudes(1.0, 1e3),
    reals(0.0, 1.2),
    reals(1e-3, 1.0),
)
def test_a_performance_function_falls_to_its_final_bound(
    form, initial, final, duration, share, later
):
    function = form(initial, final, duration)
    now, then = (evaluate(function, s * duration) for s in (share, share + later))
    assert float(now.value) >= float(then.value) >= float(function.final_bound)
    assert float(now.rate) <= 0.0
    if share >= 1.0:
        assert float(now.value) == float(function.final_bound)
    assert bool(now.settled) == (share * duration >= duration)


@examples
@given(
    reals(-1.0, 1.0),
    reals(-1e3, 1e3),
    magnitudes(1e-3, 1e2),
    magnitudes(1e-3, 1e2),
    magnitudes(1e-3, 1.0),
)
def test_an_actuator_never_leaves_its_limits_nor_outruns_its_rate(
    start, wanted, rate, tau, dt
):
    limit = 0.7
    held = start * limit
    actuator = Actuator(limit, rate, tau)
    after = float(follow(actuator, held, wanted, dt))
    assert abs(after) <= limit * (1 + 1e-15)
    assert abs(after - held) <= rate * dt * (1 + 1e-12) + 1e-15
    aim = float(np.clip(wanted, -limit, limit))
    assert min(held, aim) - 1e-15 <= after <= max(held, aim) + 1e-15
