"""The velocity of a glider that glides steadily, from its depth rate and pitch.

No glider measures its speed through the water. Where lift and drag are in balance, the
pitch alone fixes the angle of attack and so the slope of the path, and the depth rate
then fixes the speed: with ξ = θ − α the angle of the path,

α = −((K_D0 + K_D α²) cot ξ + K_L0)/K_L,   U = −Z'/tan ξ,

by iteration. A glider that is nearly level tells nothing of its speed: it keeps the one
it had, which fades.

Source: what the on-board programs of Slocum gliders and of gliderflight do.
"""

import math

import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.vehicle.parameters import GliderParameters

LEVEL = math.radians(11.0)
"""Pitch below which a glider is too level to tell its speed [rad]."""
FADE = 7.5
"""Time in which the speed fades that a level glider had [s]."""
_ROUNDS = 5
_LARGEST_ANGLE = 0.2
"""Angle of attack that the iteration does not exceed [rad]."""


def angle_of_attack(
    parameters: GliderParameters, induced_drag: Scalar, pitch: Scalar
) -> Scalar:
    """α [rad] of a steady glide.

    Args:
        parameters: parameters of the glider.
        induced_drag: K_D [kg/m/rad²].
        pitch: θ [rad]; nearer to level than `LEVEL` it is taken for that.
    """
    c = parameters
    steep = jnp.where(pitch < 0.0, -1.0, 1.0) * jnp.maximum(jnp.abs(pitch), LEVEL)
    alpha = jnp.zeros_like(pitch)
    for _ in range(_ROUNDS):
        drag = c.drag + induced_drag * alpha * alpha
        alpha = -(drag / jnp.tan(steep - alpha) + c.lift_offset) / c.lift_slope
        alpha = jnp.clip(alpha, -_LARGEST_ANGLE, _LARGEST_ANGLE)
    return alpha


def horizontal_speed(
    pitch: Scalar, alpha: Scalar, depth_rate: Scalar, before: Scalar, dt: Scalar
) -> Scalar:
    """U [m/s] through the water, or what is left of the one before.

    Args:
        pitch: θ [rad].
        alpha: α [rad].
        depth_rate: Z' [m/s].
        before: U one tick ago [m/s].
        dt: tick [s].
    """
    told = jnp.abs(pitch) >= LEVEL
    slope = jnp.where(told, pitch - alpha, 1.0)
    # A glider that sinks nose up, or rises nose down, is not gliding.
    speed = jnp.clip(-depth_rate / jnp.tan(slope), 0.0, 2.0)
    return jnp.where(told, speed, before * jnp.exp(-dt / FADE))
