"""Value and gradient of a scalar function, by the mode that is faster.

Reverse mode costs a few evaluations whatever the number of inputs. Forward mode carries
one tangent for each input beside the value; under `vmap` the tangents become lanes, and
lanes of a vector register that would stay empty cost little. So forward mode wins for
few inputs of a function that fills few lanes: see `benchmarks/bench_gradient.py`.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar, Series

FEW_LANES = 8
"""Tangents and value together, over all members, that forward mode is taken for."""

Function = Callable[..., Scalar]


def value_and_gradient(
    function: Function, mode: str = "auto", *, members: int = 1
) -> Callable[..., tuple[Scalar, Series]]:
    """A function of the same arguments that gives the value and its gradient.

    Args:
        function: scalar, of a vector and further arguments; pure.
        mode: `reverse`, `forward`, or `auto` for the faster one.
        members: number of copies that run side by side, as lanes of a `vmap`.

    Returns:
        Takes the vector and the further arguments; gives the value and its derivative
        in each component of the vector. Both modes agree to rounding.

    Raises:
        ValueError: an unknown mode.
    """
    if mode not in ("auto", "forward", "reverse"):
        raise ValueError(
            f"mode must be one of auto, forward, reverse; received {mode!r}."
        )
    reverse = jax.value_and_grad(function)

    def forward(x: Series, *rest: Any) -> tuple[Scalar, Series]:
        def along(tangent: Series) -> tuple[Scalar, Scalar]:
            return jax.jvp(lambda at: function(at, *rest), (x,), (tangent,))

        directions = jnp.eye(x.shape[0], dtype=x.dtype)
        return jax.vmap(along, out_axes=(None, 0))(directions)

    def chosen(x: Series, *rest: Any) -> tuple[Scalar, Series]:
        few = members * (x.shape[0] + 1) <= FEW_LANES
        lanes = jax.default_backend() == "cpu" and few
        use_forward = mode == "forward" or (mode == "auto" and lanes)
        return (forward if use_forward else reverse)(x, *rest)

    return chosen
