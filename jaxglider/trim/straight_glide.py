"""Steady straight glides in closed form, and how shallow they can be.

Source: N. E. Leonard and J. G. Graver, IEEE Journal of Oceanic Engineering 26 (2001)
633-645; J. G. Graver's thesis, Princeton 2005. On a straight glide weight balances lift
and drag, D = (K_D0 + K_D α²) V² and L = (K_L0 + K_L α) V², so that the glide angle ξ
alone fixes the angle of attack.
"""

import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import square_root
from jaxglider.core.rotations import direction
from jaxglider.signals import BodyAxes, Command, GliderState
from jaxglider.vehicle.full_plant import FullPlant
from jaxglider.vehicle.mass_matrix import mass_matrix
from jaxglider.vehicle.plant import AbstractPlant


def glide_limits(plant: FullPlant) -> tuple[Scalar, Scalar]:
    """The shallowest dive and climb, ξ < 0 and ξ > 0 [rad].

    The root in `angle_of_attack` is real for
    K_D0 cot²ξ + K_L0 cot ξ ≤ K_L²/(4 K_D); at its ends lift over drag is greatest.
    """
    c = plant.parameters
    half = jnp.sqrt(
        c.lift_offset**2 + c.drag * c.lift_slope**2 / plant.body.induced_drag
    )
    dive, climb = (
        (-c.lift_offset + sign * half) / (2.0 * c.drag) for sign in (-1.0, 1.0)
    )
    return jnp.arctan(1.0 / dive), jnp.arctan(1.0 / climb)


def angle_of_attack(plant: FullPlant, glide_angle: Scalar | float) -> Scalar:
    """α [rad] on a straight glide; NaN if none is so shallow.

    α = (K_L/2K_D) tan ξ (−1 + √(1 − 4 (K_D/K_L²) cot ξ (K_D0 cot ξ + K_L0))).

    Args:
        plant: the glider.
        glide_angle: ξ [rad], negative for a dive.
    """
    c, induced = plant.parameters, plant.body.induced_drag
    tangent = jnp.tan(glide_angle)
    under = (c.drag / tangent + c.lift_offset) / tangent
    root = jnp.sqrt(1.0 - 4.0 * induced / c.lift_slope**2 * under)
    return 0.5 * c.lift_slope / induced * tangent * (root - 1.0)


def straight_glide(
    plant: FullPlant, glide_angle: Scalar | float, speed: Scalar | float
) -> tuple[GliderState, Command[Scalar]]:
    """State and command of a straight glide, NaN if none is so shallow.

    Args:
        plant: the glider.
        glide_angle: ξ [rad], negative for a dive.
        speed: V [m/s].
    """
    c, g = plant.parameters, plant.parameters.gravity
    alpha = angle_of_attack(plant, glide_angle)
    pitch = glide_angle + alpha
    drag = (c.drag + plant.body.induced_drag * alpha * alpha) * speed * speed
    buoyancy_mass = -drag / (g * jnp.sin(glide_angle))
    u, w = speed * jnp.cos(alpha), speed * jnp.sin(alpha)
    zero = 0.0 * g
    mass = mass_matrix(c, plant.body, Command(buoyancy_mass, zero, zero))
    moment = (
        (mass.heave - mass.surge) * u * w
        + (c.pitch_moment_offset + c.pitch_moment_slope * alpha) * speed * speed
        - mass.below * g * jnp.sin(pitch)
    )
    ahead = moment / (g * jnp.cos(pitch))
    position = (ahead - mass.ahead) / c.moving_mass
    state = GliderState.at_rest(pitch=pitch, surge=u, heave=w)
    return state, Command(buoyancy_mass, position, zero)


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
