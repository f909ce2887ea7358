"""Explicit Runge-Kutta steps of fixed size over any pytree; knows no physics.

A state and its derivative are one type. The tableau is walked by a scan, so the
compiled program holds the derivative once, however many stages there are.
"""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import barrier

State = TypeVar("State")


class Tableau(eqx.Module):
    """An explicit Runge-Kutta method whose stages each build on the one before only.

    Attributes:
        nodes: fractions of the step at which the stages are evaluated, cᵢ in [0, 1].
        links: step of the next stage along this slope, aᵢ₊₁,ᵢ; zero for the last.
        weights: weights of the slopes in the result, bᵢ.
        order: order of convergence.
    """

    nodes: tuple[float, ...] = eqx.field(static=True)
    links: tuple[float, ...] = eqx.field(static=True)
    weights: tuple[float, ...] = eqx.field(static=True)
    order: int = eqx.field(static=True)


RK4 = Tableau(
    nodes=(0.0, 0.5, 0.5, 1.0),
    links=(0.5, 0.5, 1.0, 0.0),
    weights=(1 / 6, 1 / 3, 1 / 3, 1 / 6),
    order=4,
)
"""The classical method of fourth order."""


def runge_kutta_step(
    tableau: Tableau,
    derivative: Callable[[State, Scalar], State],
    state: State,
    step: Scalar,
) -> State:
    """Advance a state by one step.

    Args:
        tableau: the method.
        derivative: rate of change from the state and the fraction of the step in [0, 1]
            at which it is asked for.
        state: pytree of floating arrays.
        step: step size [s].

    Returns:
        The state one step later. Increments are carried, and added to the state once:
        that keeps single precision accurate over long runs.
    """
    dtype = jnp.result_type(*jax.tree.leaves(state))
    nodes, links, weights = (
        jnp.asarray(np.asarray(column), dtype)
        for column in (tableau.nodes, tableau.links, tableau.weights)
    )

    def stage(carry: tuple[State, State], row: tuple[Scalar, ...]) -> tuple:
        at, total = carry
        node, link, weight = row
        slope = barrier(derivative(at, node))
        total = jax.tree.map(lambda s, k: s + weight * k, total, slope)
        at = jax.tree.map(lambda s, k: s + link * k, state, slope)
        return (at, total), None

    zero = jax.tree.map(jnp.zeros_like, state)
    rows = (nodes, step * links, step * weights)
    (_, total), _ = lax.scan(stage, (state, zero), rows)
    return _add(state, total)


def _add(state: State, increment: State) -> State:
    return jax.tree.map(jnp.add, state, increment)
