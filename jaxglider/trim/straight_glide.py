"""Steady straight glides: how shallow they can be, and the polar.

Source: N. E. Leonard and J. G. Graver, IEEE Journal of Oceanic Engineering 26 (2001)
633-645; J. G. Graver's thesis, Princeton 2005. On a straight glide weight balances lift
and drag, D = (K_D0 + K_D α²) V² and L = (K_L0 + K_L α) V², so that the glide angle ξ
alone fixes the angle of attack,

α = (K_L/2K_D) tan ξ (−1 + √(1 − 4 (K_D/K_L²) cot ξ (K_D0 cot ξ + K_L0))).
"""

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar, Series
from jaxglider.core.numerics import square_root
from jaxglider.core.rotations import direction
from jaxglider.signals import BodyAxes
from jaxglider.vehicle.full_plant import FullPlant
from jaxglider.vehicle.plant import AbstractPlant


def glide_limits(plant: FullPlant) -> tuple[Scalar, Scalar]:
    """The shallowest dive and climb, ξ < 0 and ξ > 0 [rad].

    The root in α is real for K_D0 cot²ξ + K_L0 cot ξ ≤ K_L²/(4 K_D); at its ends lift
    over drag is greatest.

    Args:
        plant: glider.
    """
    c = plant.parameters
    half = jnp.sqrt(
        c.lift_offset**2 + c.drag * c.lift_slope**2 / plant.body.induced_drag
    )
    dive, climb = (
        (-c.lift_offset + sign * half) / (2.0 * c.drag) for sign in (-1.0, 1.0)
    )
    return jnp.arctan(1.0 / dive), jnp.arctan(1.0 / climb)


def glide_polar(
    plant: AbstractPlant, buoyancy_mass: Scalar | float, alpha: Scalar
) -> tuple[Scalar, Scalar]:
    """Glide angle ξ [rad] and speed V [m/s] at an angle of attack, in any plant.

    The force F V² of the water carries m_b g, so that V² = |m_b| g/|F|, and is upright.
    NaN where it would push the glider forward.

    Args:
        plant: the glider.
        buoyancy_mass: m_b [kg].
        alpha: α [rad].
    """
    zero = jnp.zeros_like(alpha)
    u, w = jnp.cos(alpha), jnp.sin(alpha)
    force = plant.water(BodyAxes(u, zero, w, zero, zero, zero))
    size = square_root(force.surge**2 + force.heave**2)
    along = u * force.surge + w * force.heave
    across = jnp.abs(u * force.heave - w * force.surge)
    speed = jnp.sqrt(jnp.abs(buoyancy_mass) * plant.parameters.gravity / size)
    upward = jnp.sign(buoyancy_mass) * force.heave < 0.0
    held = (along < 0.0) & upward
    slope = jnp.sign(buoyancy_mass) * direction(across, along)
    return jnp.where(held, slope, jnp.nan), speed


@jax.jit
def glide_polars(
    plant: AbstractPlant, buoyancy_mass: Scalar | float, alphas: Series
) -> tuple[Series, Series]:
    """The same at many angles of attack, compiled once for all plants of one kind.

    Args:
        plant: glider.
        buoyancy_mass: m_b [kg].
        alphas: α [rad].
    """
    return jax.vmap(glide_polar, (None, None, 0))(plant, buoyancy_mass, alphas)
