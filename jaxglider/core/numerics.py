"""Scalar mathematics with the singular points taken care of; knows no glider.

Each function here owns one singular point of the theory, so that no formula elsewhere
has to guard itself. Everything is elementwise on scalars: `vmap` turns it into lanes.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxglider.core.containers import Counter, Scalar, Series
from jaxglider.core.elementary import arctan as arctan
from jaxglider.core.elementary import barrier as barrier
from jaxglider.core.elementary import exp2, log2
from jaxglider.core.elementary import sincos as sincos


@jax.custom_jvp
def scale_gradient(x: Float[Array, "..."], share: Scalar) -> Float[Array, "..."]:
    """The same numbers, of whose derivative only a share goes on.

    Once a tick on what a closed loop remembers, it makes the gradient of a long run
    forget: see `rollout.evaluate`.

    Args:
        x: numbers, of any shape.
        share: share of the derivative that goes on, in [0, 1].
    """
    return x


@scale_gradient.defjvp
def _faded_jvp(
    primals: tuple[Any, Scalar], tangents: tuple[Any, Any]
) -> tuple[Any, Any]:
    return primals[0], primals[1] * tangents[0]


@jax.custom_jvp
def square_root(x: Scalar) -> Scalar:
    """√x for x ≥ 0, of slope zero where x is zero.

    The slope of the native one is infinite there, and times the zero that an error of
    exactly zero hands on, NaN: the whole gradient of a rollout is lost. A root mean
    square, a speed or a distance has a kink at zero, and zero is its middle slope.
    """
    return jnp.sqrt(x)


@square_root.defjvp
def _square_root_jvp(
    primals: tuple[Scalar], tangents: tuple[Scalar]
) -> tuple[Scalar, Scalar]:
    value, (dot,) = square_root(*primals), tangents
    slope = jnp.where(value == 0.0, 0.0, 0.5 / jnp.where(value == 0.0, 1.0, value))
    return value, dot * slope


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


def saturate(x: Scalar, limit: Scalar) -> Scalar:
    """Clip to [−limit, limit]; the slope is one inside and zero outside.

    Args:
        x: number.
        limit: largest modulus.
    """
    return jnp.clip(x, -limit, limit)


def select(index: Counter, values: Series) -> Scalar:
    """values[index] for a traced index from 0 on, the last value past the end.

    One look-up whatever their number: a chain of selections as long as the list took
    half a second to compile for each entry, and is no faster for five.

    Args:
        index: number of the value wanted.
        values: values to choose from.
    """
    return values.at[index].get(mode="clip")


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def implicit_root(
    function: Callable[[Scalar, Any], tuple[Scalar, Scalar]],
    root: Scalar,
    target: Scalar,
    parameters: Any,
) -> Scalar:
    """A root of function(y, parameters) = target, with its derivative.

    The value is the root as it was found; the derivative is that of the exact root, by
    the implicit function theorem, however it was found.

    Args:
        function: function that gives its value and its slope in y; the slope is not
            zero.
        root: y; not differentiated.
        target: right-hand side.
        parameters: pytree of the function's other arguments.
    """
    return root


@implicit_root.defjvp
def _implicit_root_jvp(
    function: Callable[[Scalar, Any], tuple[Scalar, Scalar]],
    primals: tuple[Scalar, Scalar, Any],
    tangents: tuple[Scalar, Scalar, Any],
) -> tuple[Scalar, Scalar]:
    root, _, parameters = primals
    _, target_dot, parameters_dot = tangents
    _, slope = function(root, parameters)
    _, value_dot = jax.jvp(
        lambda p: function(root, p)[0], (parameters,), (parameters_dot,)
    )
    return root, (target_dot - value_dot) / slope


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
