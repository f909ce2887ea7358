"""Linear-quadratic design: sampling a linear model, and the discrete Riccati equation.

The cost Σ xᵀQx + uᵀRu of x₊ = A x + B u is least for u = −K x with

P = Q + Aᵀ P (I + G P)⁻¹ A,   G = B R⁻¹ Bᵀ,   K = (R + Bᵀ P B)⁻¹ Bᵀ P A.

Doubling finds P in a fixed number of rounds, so that it compiles and differentiates as
any other formula: from A, G, H = Q, with W = I + G H,

A ← A W⁻¹ A,   G ← G + A W⁻¹ G Aᵀ,   H ← H + Aᵀ H W⁻¹ A,

H goes to P. Round n sees 2ⁿ steps ahead, and errs by what is left of a state then.

Source: E. K.-W. Chu, H.-Y. Fan, W.-W. Lin and C.-S. Wang, Int. J. Control 77 (2004)
767-788; C. F. Van Loan, IEEE Trans. Automatic Control 23 (1978) 395-404 (sampling).
"""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

ROUNDS = 20
"""Rounds of doubling; the closed loop is looked at 2²⁰ steps ahead."""
_SQUARINGS = 6
_TERMS = 8


def sampled(
    a: Float[Array, "n n"], b: Float[Array, "n m"], period: Float[Array, ""]
) -> tuple[Float[Array, "n n"], Float[Array, "n m"]]:
    """A and B of one period with the input held: e^{AT} and ∫e^{At}B dt.

    The series of a 2⁻⁶th of the period, squared six times: to rounding where the
    fastest rate of A times the period is below about 50.

    Args:
        a: matrix of x' = a x + b u [1/s].
        b: matrix of the input.
        period: T [s].
    """
    n, m = b.shape
    whole = jnp.zeros((n + m, n + m), a.dtype).at[:n].set(jnp.hstack([a, b]))
    part = whole * (period / 2.0**_SQUARINGS)
    term = power = jnp.eye(n + m, dtype=a.dtype)
    for order in range(1, _TERMS + 1):
        term = term @ part / order
        power = power + term
    for _ in range(_SQUARINGS):
        power = power @ power
    return power[:n, :n], power[:n, n:]


def regulator_gain(
    a: Float[Array, "n n"],
    b: Float[Array, "n m"],
    q: Float[Array, "n n"],
    r: Float[Array, "m m"],
) -> Float[Array, "m n"]:
    """K of the regulator u = −K x.

    Args:
        a: A of one step.
        b: B of one step.
        q: Q, positive semidefinite.
        r: R, positive definite.
    """
    p = cost_to_go(a, b, q, r)
    return jnp.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)


def cost_to_go(
    a: Float[Array, "n n"],
    b: Float[Array, "n m"],
    q: Float[Array, "n n"],
    r: Float[Array, "m m"],
) -> Float[Array, "n n"]:
    """P of xᵀPx, the cost of all that is to come from x on under the regulator.

    Args:
        a: A of one step.
        b: B of one step.
        q: Q, positive semidefinite.
        r: R, positive definite.
    """
    eye = jnp.eye(a.shape[0], dtype=a.dtype)

    def double(
        state: tuple[Array, Array, Array], _: None
    ) -> tuple[tuple[Array, Array, Array], None]:
        a, g, h = state
        left = jnp.linalg.solve(eye + g @ h, jnp.hstack([a, g]))
        wa, wg = left[:, : a.shape[0]], left[:, a.shape[0] :]
        following = (
            a @ wa,
            _even(g + a @ wg @ a.T),
            _even(h + a.T @ h @ wa),
        )
        return following, None

    start = a, b @ jnp.linalg.solve(r, b.T), q
    (_, _, p), _ = lax.scan(double, start, length=ROUNDS)
    return p


def _even(x: jax.Array) -> jax.Array:
    """The symmetric part: roundings would else grow from round to round."""
    return 0.5 * (x + x.T)
