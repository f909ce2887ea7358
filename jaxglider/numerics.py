"""Scalar mathematics with the singular points taken care of; knows no glider.

Each function here owns one singular point of the theory, so that no formula elsewhere
has to guard itself. Everything is elementwise on scalars: `vmap` turns it into lanes.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxglider._types import Counter, Scalar


class _Float(NamedTuple):
    """A floating format: its bits, and how many terms its series need for rounding."""

    whole: type[np.signedinteger]
    mantissa_bits: int
    exponent_bits: int
    # π in three parts, the first two short enough for k times them to be exact.
    pi: tuple[float, float, float]
    sincos_terms: int
    log_terms: int
    exp_terms: int


_FLOATS = {
    "float32": _Float(
        np.int32,
        23,
        8,
        (3.140625, 9.675025939941406e-4, 1.5099579897537296e-7),
        7,
        6,
        8,
    ),
    "float64": _Float(
        np.int64,
        52,
        11,
        (3.1415926534682512, 1.2154201012607932e-10, 4.044532497591901e-21),
        11,
        11,
        14,
    ),
}


@jax.custom_jvp
def sincos(angle: Scalar) -> tuple[Scalar, Scalar]:
    """Sine and cosine of one angle [rad]: the one place where a tick computes them.

    Whole half turns taken off, then the two Taylor series to rounding. Native sine and
    cosine are called once per lane on a CPU; this vectorises, and a batch of 64 gliders
    runs four times as fast. Within 2 units in the last place of 1, up to 1e4 rad.
    """
    kind = _FLOATS[str(angle.dtype)]
    first, second, third = kind.pi
    turns = jnp.floor(angle * (1.0 / math.pi) + 0.5)
    y = ((angle - turns * first) - turns * second) - turns * third
    sign = 1.0 - 2.0 * (turns - 2.0 * jnp.floor(0.5 * turns))
    signs = [(-1.0) ** n for n in range(kind.sincos_terms)]
    sine = [s / math.factorial(2 * n + 1) for n, s in enumerate(signs)]
    cosine = [s / math.factorial(2 * n) for n, s in enumerate(signs)]
    return once(sign * y * horner(y * y, sine)), once(sign * horner(y * y, cosine))


@sincos.defjvp
def _sincos_jvp(
    primals: tuple[Scalar], tangents: tuple[Scalar]
) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]:
    sine, cosine = sincos(*primals)
    (dot,) = tangents
    return (sine, cosine), (cosine * dot, -sine * dot)


@jax.custom_jvp
def once(x: Scalar) -> Scalar:
    """The same number, computed once however many formulas use it.

    XLA for CPUs copies a cheap formula into each of its users, and with theirs into
    each of theirs: unhindered, a tick computes its command eighteen times. It does not
    copy a division. Infinity becomes NaN.
    """
    return x / _one_if_finite(x)


def _one_if_finite(x: Scalar) -> Scalar:
    """1 for every finite number, in a way the compiler does not see; NaN for others."""
    return 0.0 * x + 1.0


@once.defjvp
def _once_jvp(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    return once(*primals), tangents[0]


@jax.custom_jvp
def faded(x: Scalar, share: Scalar) -> Scalar:
    """The same number, of whose derivative only a share goes on.

    Once a tick on what a closed loop remembers, it makes the gradient of a long run
    forget: see `rollout.evaluate`.
    """
    return x


@faded.defjvp
def _faded_jvp(
    primals: tuple[Scalar, Scalar], tangents: tuple[Scalar, Scalar]
) -> tuple[Scalar, Scalar]:
    return primals[0], primals[1] * tangents[0]


def smooth_abs(x: Scalar, smoothing: Scalar) -> Scalar:
    """Smoothed modulus, sqrt(x² + δ²): positive, and its slope at zero is zero."""
    return jnp.sqrt(x * x + smoothing * smoothing)


@jax.custom_jvp
def arctan(x: Scalar) -> Scalar:
    """Angle [rad] whose tangent is x, within 4 units in the last place.

    From tan a to tan a/4 by the half-angle formula, t/(1 + √(1 + t²)), twice, then the
    Taylor series. The native one is called once per lane on a CPU; this vectorises.
    """
    kind = _FLOATS[str(x.dtype)]
    size = jnp.abs(x)
    t = jnp.minimum(size, 1.0) / jnp.maximum(size, 1.0)
    for _ in range(2):
        t = t / (1.0 + jnp.sqrt(1.0 + t * t))
    terms = [(-1.0) ** n / (2 * n + 1) for n in range(kind.log_terms)]
    angle = 4.0 * t * horner(t * t, terms)
    return jnp.sign(x) * jnp.where(size > 1.0, 0.5 * math.pi - angle, angle)


@arctan.defjvp
def _arctan_jvp(
    primals: tuple[Scalar], tangents: tuple[Scalar]
) -> tuple[Scalar, Scalar]:
    (x,), (dot,) = primals, tangents
    return arctan(x), dot / (1.0 + x * x)


@jax.custom_jvp
def log2(x: Scalar) -> Scalar:
    """Binary logarithm of a positive number, within 2 units in the last place.

    Exponent and mantissa m in [√½, √2) taken apart, then log m = 2 artanh((m−1)/(m+1))
    by its series. Native logarithms in double precision are called once per lane on a
    CPU; this vectorises. NaN and infinity give NaN; zero and less, nothing of use.
    """
    kind = _FLOATS[str(x.dtype)]
    low = np.array(math.sqrt(0.5), x.dtype).view(kind.whole)
    bits = lax.bitcast_convert_type(x, kind.whole) - low
    exponent = (bits >> kind.mantissa_bits).astype(x.dtype)
    mask = (kind.whole(1) << kind.mantissa_bits) - kind.whole(1)
    m = lax.bitcast_convert_type((bits & mask) + low, x.dtype)
    s = (m - 1.0) / (m + 1.0)
    terms = [2.0 / (math.log(2.0) * (2 * n + 1)) for n in range(kind.log_terms)]
    return (exponent + s * horner(s * s, terms)) / _one_if_finite(x)


@log2.defjvp
def _log2_jvp(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    (x,), (dot,) = primals, tangents
    return log2(x), dot / (math.log(2.0) * x)


@jax.custom_jvp
def exp2(x: Scalar) -> Scalar:
    """2^x within 2 units in the last place, for results that are normal numbers.

    The whole part of x goes into the exponent of the result, the rest, within ±½,
    through the Taylor series. Smaller and larger results stay at the ends of the normal
    numbers; NaN and infinity give NaN.
    """
    kind = _FLOATS[str(x.dtype)]
    reach = 2.0 ** (kind.exponent_bits - 1) - 2.0
    inside = jnp.clip(x, -reach, reach)
    nearest = jnp.floor(inside + 0.5)
    terms = [math.log(2.0) ** n / math.factorial(n) for n in range(kind.exp_terms)]
    mantissa = lax.bitcast_convert_type(horner(inside - nearest, terms), kind.whole)
    # Adding 1.5 · 2^mantissa_bits puts a whole number into the last bits.
    shifted = nearest + 1.5 * 2.0**kind.mantissa_bits
    whole = lax.bitcast_convert_type(shifted, kind.whole) << kind.mantissa_bits
    return lax.bitcast_convert_type(mantissa + whole, x.dtype) / _one_if_finite(x)


@exp2.defjvp
def _exp2_jvp(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    y = exp2(*primals)
    return y, math.log(2.0) * y * tangents[0]


def horner(x: Scalar, coefficients: Sequence[float]) -> Scalar:
    """The polynomial c₀ + c₁ x + c₂ x² + ... ."""
    value = jnp.full_like(x, coefficients[-1])
    for c in reversed(coefficients[:-1]):
        value = value * x + c
    return value


def modulus_powers(
    x: Scalar, exponents: Sequence[Scalar], smoothing: Scalar
) -> tuple[Scalar, ...]:
    """Powers of the smoothed modulus, (x² + δ²)^(p/2) for several p, by one logarithm.

    Args:
        x: the base.
        exponents: the powers p.
        smoothing: δ > 0, in the unit of x.
    """
    log_modulus = 0.5 * log2(x * x + smoothing * smoothing)
    return tuple(exp2(p * log_modulus) for p in exponents)


def signed_powers(
    x: Scalar, exponents: Sequence[Scalar], smoothing: Scalar
) -> tuple[Scalar, ...]:
    """Smoothed signed powers, sig^a_δ(x) = x (x² + δ²)^((a−1)/2), for several a.

    The unsmoothed |x|^a sgn(x) has an infinite slope at zero for a < 1, and a control
    loop crosses zero on every tick: its exact derivative is then useless. Away from
    zero the two agree to (δ/x)²(a−1)/2.

    Args:
        x: the base.
        exponents: the powers a, each at least zero.
        smoothing: δ > 0, in the unit of x.

    Returns:
        One value for each exponent.
    """
    powers = modulus_powers(x, [a - 1.0 for a in exponents], smoothing)
    return tuple(x * power for power in powers)


def signed_power(x: Scalar, exponent: Scalar, smoothing: Scalar) -> Scalar:
    """Smoothed signed power of one exponent; see `signed_powers`."""
    return signed_powers(x, (exponent,), smoothing)[0]


def saturate(x: Scalar, limit: Scalar) -> Scalar:
    """Clip to [−limit, limit]; the slope is one inside and zero outside."""
    return jnp.clip(x, -limit, limit)


def select(index: Counter, values: Sequence[Scalar]) -> Scalar:
    """values[index] for a traced index, the last value past the end.

    A chain of elementwise selections: it vectorises over lanes, a gather does not.
    """
    chosen = values[-1]
    for i in range(len(values) - 2, -1, -1):
        chosen = jnp.where(index == i, values[i], chosen)
    return chosen


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def monotone_root(
    function: Callable[[Scalar, Any], tuple[Scalar, Scalar]],
    steps: int,
    target: Scalar,
    start: Scalar,
    parameters: Any,
) -> Scalar:
    """Solve function(y, parameters) = target for y, by Newton's method kept in bracket.

    The function gives its value and its slope in y. It must vanish at zero and rise
    with slope one or more; the root then lies between zero and the target. A Newton
    step that leaves the bracket is replaced by a bisection. The derivative is that of
    the exact root, by the implicit function theorem, and never runs through the
    iterations.

    Args:
        function: the rising function of y and of `parameters`.
        steps: number of iterations, fixed.
        target: right-hand side.
        start: first guess, the better the fewer steps are needed; not differentiated.
        parameters: pytree of the function's other arguments; differentiated.

    Returns:
        The root y.
    """
    low, high = jnp.minimum(target, 0.0), jnp.maximum(target, 0.0)
    y = jnp.clip(start, low, high)
    for _ in range(steps):
        value, slope = function(y, parameters)
        # The sides follow the step: a residual of rounding size can differ in sign
        # from one compiled copy of its formula to the next.
        step = (value - target) / slope
        low, high = jnp.where(step > 0.0, low, y), jnp.where(step > 0.0, y, high)
        newton = y - step
        inside = (newton >= low) & (newton <= high)
        y = jnp.where(inside, newton, 0.5 * (low + high))
    return y


@monotone_root.defjvp
def _monotone_root_jvp(
    function: Callable[[Scalar, Any], tuple[Scalar, Scalar]],
    steps: int,
    primals: tuple[Scalar, Scalar, Any],
    tangents: tuple[Scalar, Scalar, Any],
) -> tuple[Scalar, Scalar]:
    target, start, parameters = primals
    target_dot, _, parameters_dot = tangents
    y = monotone_root(function, steps, target, start, parameters)
    _, slope = function(y, parameters)
    _, value_dot = jax.jvp(
        lambda p: function(y, p)[0], (parameters,), (parameters_dot,)
    )
    return y, (target_dot - value_dot) / slope


def solve_symmetric(
    diagonal: tuple[Scalar, Scalar, Scalar],
    off_diagonal: tuple[Scalar, Scalar, Scalar],
    right: tuple[Scalar, Scalar, Scalar],
) -> tuple[Scalar, Scalar, Scalar]:
    """Solve a symmetric positive definite 3×3 system in closed form (adjugate).

    Args:
        diagonal: a00, a11, a22.
        off_diagonal: a01, a02, a12.
        right: the right-hand side.

    Returns:
        The three unknowns.
    """
    a00, a11, a22 = diagonal
    a01, a02, a12 = off_diagonal
    b0, b1, b2 = right
    c00, c01, c02 = a11 * a22 - a12 * a12, a12 * a02 - a01 * a22, a01 * a12 - a11 * a02
    c11, c12, c22 = a00 * a22 - a02 * a02, a01 * a02 - a00 * a12, a00 * a11 - a01 * a01
    # Three divisions, not one reciprocal: each unknown is then computed once.
    determinant = a00 * c00 + a01 * c01 + a02 * c02
    return (
        (c00 * b0 + c01 * b1 + c02 * b2) / determinant,
        (c01 * b0 + c11 * b1 + c12 * b2) / determinant,
        (c02 * b0 + c12 * b1 + c22 * b2) / determinant,
    )
