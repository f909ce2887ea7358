"""Attitude of a body in the north-east-down frame (Fossen 1994); knows no glider.

Euler angles roll φ, pitch θ, heading ψ in the order z-y-x. The map from body rates to
Euler rates is singular at θ = ±π/2.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import arctan, sincos


class Attitude(eqx.Module):
    """Sines and cosines of the three Euler angles, computed once for one instant."""

    sin_roll: Scalar
    cos_roll: Scalar
    sin_pitch: Scalar
    cos_pitch: Scalar
    sin_heading: Scalar
    cos_heading: Scalar


def attitude(roll: Scalar, pitch: Scalar, heading: Scalar) -> Attitude:
    """Sines and cosines of roll, pitch and heading [rad].

    Args:
        roll: φ [rad].
        pitch: θ [rad].
        heading: ψ [rad].
    """
    return Attitude(*sincos(roll), *sincos(pitch), *sincos(heading))


def body_to_ned(
    a: Attitude, x: Scalar, y: Scalar, z: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Rotate a body-frame vector into the north-east-down frame.

    R(φ,θ,ψ) (x, y, z); its third row is the T of the paper's kinematics, and turns body
    velocity into the rate of depth.

    Args:
        a: attitude of the body.
        x: component along the body's forward axis, in any unit.
        y: component to starboard.
        z: component downward.

    Returns:
        Components north, east and down, in the same unit.
    """
    across = a.cos_roll * y - a.sin_roll * z
    down = a.sin_roll * y + a.cos_roll * z
    ahead = a.cos_pitch * x + a.sin_pitch * down
    return (
        a.cos_heading * ahead - a.sin_heading * across,
        a.sin_heading * ahead + a.cos_heading * across,
        a.cos_pitch * down - a.sin_pitch * x,
    )


def ned_to_body(
    a: Attitude, north: Scalar, east: Scalar, down: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Rotate a vector of the north-east-down frame into the body frame, R(φ,θ,ψ)ᵀ.

    Args:
        a: attitude of the body.
        north: component to the north, in any unit.
        east: component to the east.
        down: component downward.

    Returns:
        Components forward, to starboard and downward in the body, in the same unit.
    """
    ahead = a.cos_heading * north + a.sin_heading * east
    across = a.cos_heading * east - a.sin_heading * north
    below = a.sin_pitch * ahead + a.cos_pitch * down
    return (
        a.cos_pitch * ahead - a.sin_pitch * down,
        a.sin_roll * below + a.cos_roll * across,
        a.cos_roll * below - a.sin_roll * across,
    )


def euler_rates(
    a: Attitude, roll_rate: Scalar, pitch_rate: Scalar, yaw_rate: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Rates of roll, pitch and heading [rad/s] from the body rates p, q, r [rad/s].

    φ' = p + tanθ (sinφ q + cosφ r), θ' = cosφ q − sinφ r, ψ' = (sinφ q + cosφ r)/cosθ.
    The last two are the R of the paper's kinematics. Singular at θ = ±π/2.

    Args:
        a: attitude of the body.
        roll_rate: p [rad/s], body frame.
        pitch_rate: q [rad/s].
        yaw_rate: r [rad/s].
    """
    heading_dot = (a.sin_roll * pitch_rate + a.cos_roll * yaw_rate) / a.cos_pitch
    pitch_dot = a.cos_roll * pitch_rate - a.sin_roll * yaw_rate
    return roll_rate + a.sin_pitch * heading_dot, pitch_dot, heading_dot


def wrap(angle: Scalar) -> Scalar:
    """The same angle [rad] in [−π, π)."""
    turns = jnp.floor(angle * (0.5 / math.pi) + 0.5)
    return angle - 2.0 * math.pi * turns


@jax.custom_jvp
def direction(x: Scalar, y: Scalar) -> Scalar:
    """atan2(y, x) [rad], from the x axis to the y axis; zero at the origin.

    Its derivative there, which does not exist, is zero too. The native one is called
    once per lane on a CPU; this vectorises.

    Args:
        x: component along the x axis.
        y: component along the y axis, in the same unit.
    """
    steep = jnp.abs(y) > jnp.abs(x)
    over, under = jnp.where(steep, x, y), jnp.where(steep, y, x)
    angle = arctan(over / jnp.where(under == 0.0, 1.0, under))
    side = jnp.where(y < 0.0, -math.pi, math.pi)
    level = jnp.where(x < 0.0, side + angle, angle)
    return jnp.where(steep, 0.5 * side - angle, level)


@direction.defjvp
def _direction_jvp(
    primals: tuple[Scalar, Scalar], tangents: tuple[Scalar, Scalar]
) -> tuple[Scalar, Scalar]:
    (x, y), (x_dot, y_dot) = primals, tangents
    square = x * x + y * y
    square = jnp.where(square == 0.0, 1.0, square)
    return direction(x, y), (x * y_dot - y * x_dot) / square
