"""Closed forms that tests compare with."""

import jax.numpy as jnp

from jaxglider.core.rotations import attitude, body_to_ned
from jaxglider.signals import Command, GliderState
from jaxglider.vehicle.mass_matrix import mass_matrix


def rotation_matrix(roll, pitch, heading):
    """The matrix R(φ,θ,ψ) of `body_to_ned`, column by column."""
    a = attitude(roll, pitch, heading)
    columns = [body_to_ned(a, *axis) for axis in jnp.eye(3, dtype=a.sin_roll.dtype)]
    return jnp.array(columns).T


def angle_of_attack(plant, glide_angle):
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


def straight_glide(plant, glide_angle, speed):
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
