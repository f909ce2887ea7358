"""The moves of a horizon as a quadratic program with bounds, and rounds that solve it.

With v the moves u_0 ... u_{N−1} one behind the other, x₊ = A x + B u, and P the cost of
all that comes after them under the regulator without bounds,

min ½ vᵀH v + (F x)ᵀv   subject to   lo ≤ C v ≤ hi,   C v = (v, v − v before),

is min Σ xᵀx + uᵀu + x_NᵀP x_N in the units of `ScaledStep`. Without bounds it has the
solution v* = −H⁻¹F x, whose first move is that of the regulator, −K x, whatever the
horizon. What the bounds take from it, y = v − v*, is found by rounds of the alternating
direction method of multipliers, z for C y within its bounds, w the prices of the two
being apart,

y = (H + ρ CᵀC)⁻¹ ρ Cᵀ(z − w),   s = α C y + (1 − α) z,
z ← clip(s + w, lo − C v*, hi − C v*),   w ← w + s − z,

from w = 0 and z, the place within its bounds that is nearest zero: so v* stays v* where
it keeps them. ρ is the geometric mean of the least eigenvalue of H, 1, and a bound of
the largest.

Source: P. O. M. Scokaert and J. B. Rawlings, IEEE Trans. Automatic Control 43 (1998)
1163-1169 (P behind the horizon); B. Stellato and others, Mathematical Programming
Computation 12 (2020) 637-672 (the rounds, with α).
"""

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxglider.control.textbook.linear_design import ScaledStep
from jaxglider.core.riccati import cost_to_go

RELAXATION = 1.6
"""Over-relaxation α of the rounds; 1 to 1.8 converge."""


class Plan(eqx.Module):
    """Matrices of the program about one glide.

    Attributes:
        free: −H⁻¹F, from the deviation in SI units to the moves without bounds.
        rounds: ρ (H + ρ CᵀC)⁻¹.
    """

    free: Float[Array, "n x"]
    rounds: Float[Array, "n n"]


def planned(step: ScaledStep, horizon: int) -> Plan:
    """The matrices of a horizon.

    Args:
        step: linear model over the time from one move to the next.
        horizon: number of moves N.
    """
    q, r = step.costs()
    p = cost_to_go(step.a, step.b, q, r)
    n = step.a.shape[0]
    of_state, of_moves = jnp.eye(n, dtype=p.dtype), jnp.zeros((n, 3 * horizon), p.dtype)
    hessian, linear = jnp.eye(3 * horizon, dtype=p.dtype), of_moves.T
    for k in range(horizon):
        of_moves = (step.a @ of_moves).at[:, 3 * k : 3 * k + 3].set(step.b)
        of_state = step.a @ of_state
        cost = q if k < horizon - 1 else p
        hessian = hessian + of_moves.T @ cost @ of_moves
        linear = linear + of_moves.T @ cost @ of_state
    penalty = jnp.sqrt(jnp.max(jnp.sum(jnp.abs(hessian), axis=1)))
    one = jnp.eye(3 * horizon, dtype=p.dtype)
    change = one - jnp.eye(3 * horizon, k=-3, dtype=p.dtype)
    both = one + change.T @ change
    free = -jnp.linalg.solve(hessian, linear) * step.states
    return Plan(free, penalty * jnp.linalg.inv(hessian + penalty * both))


def changes(moves: Float[Array, "k 3"]) -> Float[Array, "k 3"]:
    """Each move less the one before; the first less none."""
    return moves - jnp.concatenate([jnp.zeros_like(moves[:1]), moves[:-1]])


def solved(
    plan: Plan,
    deviation: Float[Array, " x"],
    low: Float[Array, "2 k 3"],
    high: Float[Array, "2 k 3"],
    rounds: int,
) -> Float[Array, "k 3"]:
    """The moves after some rounds.

    Args:
        plan: matrices of the glide.
        deviation: x in SI units.
        low: lower bounds of the moves and of their changes, in units of the efforts.
        high: upper bounds.
        rounds: number of rounds.
    """
    free = (plan.free @ deviation).reshape(low.shape[1:])
    already = jnp.stack([free, changes(free)])
    low, high = low - already, high - already

    def once(split: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], None]:
        copies, prices = split
        level, slope = copies - prices
        later = jnp.concatenate([slope[1:], jnp.zeros_like(slope[:1])])
        pushed = plan.rounds @ (level + slope - later).reshape(-1)
        moves = pushed.reshape(free.shape)
        reached = jnp.stack([moves, changes(moves)])
        eased = RELAXATION * reached + (1.0 - RELAXATION) * copies
        copies = jnp.clip(eased + prices, low, high)
        return (copies, prices + eased - copies), None

    none = jnp.zeros_like(low)
    start = jnp.clip(none, low, high), none
    (copies, _), _ = lax.scan(once, start, length=rounds)
    return free + copies[0]
