"""Inertial and hydrodynamic forces: for small angles, and in the frame of the flow.

Source of the first: Yang and Mahmoudian, Eqs. for C(ν)ν and D(ν)ν, after Zhang et al.
2013, under Assumption 1: v, w ≪ u, so V = u, sin α = w/u, sin β = v/u. Source of the
second: Zhang, Yu, Zhang and Zhang, Ocean Engineering 60 (2013) 1-13.

Deviation from the printed equations: the last term of row 4 of Dν repeats a pitch
coefficient, −K_M0 u v; the source has none, and it is dropped.
"""

import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import barrier
from jaxglider.core.rotations import direction
from jaxglider.signals import BodyAxes
from jaxglider.vehicle.parameters import GliderParameters


def coriolis(
    parameters: GliderParameters, velocity: BodyAxes[Scalar]
) -> BodyAxes[Scalar]:
    """C(ν)ν: Coriolis and centripetal force [N] and moment [N m], body frame.

    It does no work: ν · C(ν)ν = 0.
    """
    m1, m2, m3 = parameters.surge_mass, parameters.sway_mass, parameters.heave_mass
    i1, i2 = parameters.roll_inertia, parameters.pitch_inertia
    i3 = parameters.yaw_inertia
    u, v, w = velocity.surge, velocity.sway, velocity.heave
    p, q, r = velocity.roll, velocity.pitch, velocity.yaw
    return BodyAxes(
        m2 * v * r - m3 * w * q,
        m3 * w * p - m1 * u * r,
        m1 * u * q - m2 * v * p,
        (m2 - m3) * v * w + (i2 - i3) * q * r,
        (m3 - m1) * u * w + (i3 - i1) * p * r,
        (m1 - m2) * u * v + (i1 - i2) * p * q,
    )


def hydrodynamics(
    parameters: GliderParameters, velocity: BodyAxes[Scalar]
) -> BodyAxes[Scalar]:
    """D(ν)ν: drag, lift, side force [N] and their moments [N m], body frame."""
    c = parameters
    u, v, w = velocity.surge, velocity.sway, velocity.heave
    p, q, r = velocity.roll, velocity.pitch, velocity.yaw
    uu = u * u
    return BodyAxes(
        c.lift_offset * u * w - c.drag * uu,
        (c.side_force_slope - c.drag) * u * v,
        -c.lift_offset * uu - (c.drag + c.lift_slope) * u * w,
        c.roll_damping * p * uu + c.roll_moment_slope * u * v,
        c.pitch_moment_offset * uu
        + c.pitch_damping * q * uu
        + c.pitch_moment_slope * u * w,
        c.yaw_damping * r * uu + c.yaw_moment_slope * u * v,
    )


SLOWEST = 1e-6
"""Speed [m/s] below which the flow has no direction: its frame is singular at rest."""


def flow_frame_hydrodynamics(
    parameters: GliderParameters, induced_drag: Scalar, velocity: BodyAxes[Scalar]
) -> BodyAxes[Scalar]:
    """R (−D, SF, −L) and R (T₁, T₂, T₃): force [N] and moment [N m], body frame.

    D = (K_D0 + K_D α²) V², SF = K_β β V², L = (K_L0 + K_L α) V², T₁ = (K_MR β + K_p p)
    V², T₂ = (K_M0 + K_M α + K_q q) V², T₃ = (K_MY β + K_r r) V²; α = atan2(w, u),
    β = asin(v/V), R from the frame of the flow to that of the body.
    """
    c = parameters
    u, v, w = velocity.surge, velocity.sway, velocity.heave
    p, q, r = velocity.roll, velocity.pitch, velocity.yaw
    ahead = barrier(jnp.sqrt(u * u + w * w + SLOWEST * SLOWEST))
    speed2 = barrier(ahead * ahead + v * v)
    speed = barrier(jnp.sqrt(speed2))
    alpha, beta = barrier(direction(u, w)), barrier(direction(ahead, v))
    cos_a, sin_a, cos_b, sin_b = u / ahead, w / ahead, ahead / speed, v / speed

    def to_body(x: Scalar, y: Scalar, z: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        x, y, z = barrier(speed2 * x), barrier(speed2 * y), barrier(speed2 * z)
        level = barrier(cos_b * x - sin_b * y)
        return (
            cos_a * level - sin_a * z,
            sin_b * x + cos_b * y,
            sin_a * level + cos_a * z,
        )

    drag = c.drag + induced_drag * alpha * alpha
    return BodyAxes(
        *to_body(
            -drag, c.side_force_slope * beta, -c.lift_offset - c.lift_slope * alpha
        ),
        *to_body(
            c.roll_moment_slope * beta + c.roll_damping * p,
            c.pitch_moment_offset + c.pitch_moment_slope * alpha + c.pitch_damping * q,
            c.yaw_moment_slope * beta + c.yaw_damping * r,
        ),
    )
