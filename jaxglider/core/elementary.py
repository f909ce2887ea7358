"""Elementary functions that a compiler turns into lanes, and `barrier`.

XLA for CPUs calls the native ones once per lane. These are polynomials of basic
operations, so that a batch of gliders fills the vector registers; each says how close
it comes. `numerics` builds on them, and is where others import them from.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxglider.core.compiler import not_inlined
from jaxglider.core.containers import Scalar

Tree = TypeVar("Tree")


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
@not_inlined
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
    # Adding 1.5 · 2^mantissa_bits puts the parity into the last bit: the sign.
    parity = lax.bitcast_convert_type(turns + 1.5 * 2.0**kind.mantissa_bits, kind.whole)
    sign = parity << (kind.mantissa_bits + kind.exponent_bits)
    signs = [(-1.0) ** n for n in range(kind.sincos_terms)]
    sine = [s / math.factorial(2 * n + 1) for n, s in enumerate(signs)]
    cosine = [s / math.factorial(2 * n) for n, s in enumerate(signs)]

    def signed(x: Scalar) -> Scalar:
        turned = lax.bitcast_convert_type(x, kind.whole) ^ sign
        return lax.bitcast_convert_type(turned, x.dtype)

    return signed(y * horner(y * y, sine)), signed(horner(y * y, cosine))


@sincos.defjvp
def _sincos_jvp(
    primals: tuple[Scalar], tangents: tuple[Scalar]
) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]:
    sine, cosine = sincos(*primals)
    (dot,) = tangents
    return (sine, cosine), (cosine * dot, -sine * dot)


def barrier(values: Tree) -> Tree:
    """The same numbers, computed once however many formulas use them.

    XLA for CPUs copies a cheap formula into each of its users, and with theirs into
    each of theirs: unhindered, a tick computes its command eighteen times. The same
    holds for tangents and cotangents on their way back.

    Args:
        values: number, or any pytree of them.
    """
    return _handed_on(values)


_handed_on = not_inlined(lax.optimization_barrier)


@jax.custom_jvp
@not_inlined
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
@not_inlined
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
    return exponent + s * horner(s * s, terms) + 0.0 * x


@log2.defjvp
def _log2_jvp(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    (x,), (dot,) = primals, tangents
    return log2(x), dot / (math.log(2.0) * x)


@jax.custom_jvp
@not_inlined
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
    return lax.bitcast_convert_type(mantissa + whole, x.dtype) + 0.0 * x


@exp2.defjvp
def _exp2_jvp(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    y = exp2(*primals)
    return y, math.log(2.0) * y * tangents[0]


def horner(x: Scalar, coefficients: Sequence[float]) -> Scalar:
    """The polynomial c₀ + c₁ x + c₂ x² + ... .

    Args:
        x: argument.
        coefficients: c₀, c₁, c₂ and so on.
    """
    value = jnp.full_like(x, coefficients[-1])
    for c in reversed(coefficients[:-1]):
        value = value * x + c
    return value
