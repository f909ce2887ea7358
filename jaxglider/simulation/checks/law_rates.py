"""Largest rate of a law's own variables, which a tick has to be short beside."""

from typing import Any

import jax.numpy as jnp

from jaxglider.control import PPC, SMC, FxTPPC, RollAwareFxTPPC
from jaxglider.control.controller import AbstractController
from jaxglider.core.containers import Scalar
from jaxglider.signals import map_fields


def fastest_rate(controller: AbstractController) -> Scalar | None:
    """Largest rate at which a law moves its own variables, about zero error [1/s].

    Held over a tick dt it is the law of the theory as long as dt times it is well below
    1; from 2 on the surface grows from tick to tick. With δ the smoothing,

    - FxTPPC: of the surface, (k₁ + k₂)(δ^{1/μ} + 1 + δ^{−1/μ}); of ε'' = −a₂ ε' − a₁ ε
      on it, the larger modulus of the two roots, a₁ and a₂ the slopes of A;
    - PPC: λ (l₁ + l₂), with the settled funnel; SMC: c₁ + c₂.

    Args:
        controller: law with its gains; None comes back for one of the user's own.
    """
    if isinstance(controller, RollAwareFxTPPC):
        return fastest_rate(controller.law)
    if isinstance(controller, FxTPPC):
        rates = [
            _fixed_time_rate(gains, controller)
            for gains in vars(controller.gains).values()
        ]
        return jnp.max(jnp.stack(rates))
    if isinstance(controller, PPC):
        late = controller.limits(controller.bounds(jnp.asarray(1e9)))
        slope = map_fields(lambda x: 0.5 * (1.0 / x.upper - 1.0 / x.lower), late)
        rates = map_fields(
            lambda s, a, b: s * (a + b), slope, controller.l1_margin, controller.l2
        )
        return jnp.max(jnp.stack(list(vars(rates).values())))
    if isinstance(controller, SMC):
        rates = map_fields(jnp.add, controller.c1, controller.c2)
        return jnp.max(jnp.stack(list(vars(rates).values())))
    return None


def _fixed_time_rate(gains: Any, law: FxTPPC) -> Scalar:
    """The fastest rate of one channel of FxTPPC about zero."""
    delta = law.smoothing
    for_e1, for_e2 = law.exponents(gains.rho)

    def slope(powers: Any) -> Scalar:
        return delta ** (powers[0] - 1.0) + 1.0 + delta ** (powers[1] - 1.0)

    reaching = (gains.k1 + gains.k2) * slope(
        (1.0 + 1.0 / gains.mu, 1.0 - 1.0 / gains.mu)
    )
    stiffness, damping = gains.k1 * slope(for_e1), gains.k2 * slope(for_e2)
    apart = damping * damping - 4.0 * stiffness
    real = 0.5 * (damping + jnp.sqrt(jnp.maximum(apart, 0.0)))
    root = jnp.where(apart > 0.0, real, jnp.sqrt(stiffness))
    return jnp.maximum(reaching, root)
