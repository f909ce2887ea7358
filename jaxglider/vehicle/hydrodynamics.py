"""Inertial and hydrodynamic forces: for small angles, and in the frame of the flow.

Source of the first: Yang and Mahmoudian, Eqs. for C(ν)ν and D(ν)ν, after Zhang et al.
2013, under Assumption 1: v, w ≪ u, so V = u, sin α = w/u, sin β = v/u. Source of the
second: Zhang, Yu, Zhang and Zhang, Ocean Engineering 60 (2013) 1-13.

Deviations from the printed equations:

- The last term of row 4 of Dν repeats a pitch coefficient, −K_M0 u v; the source has
  none, and it is dropped.
- They are printed for a glider that moves ahead, u > 0. Astern, V = u would turn drag
  into thrust: V is |u| here, the same number ahead. So the force never does work on the
  glider, F · v = −|u| (K_D0 V² − K_β v² + K_L w²), whichever way it moves.
- In the frame of the flow, the damping of a glider that moves astern would drive its
  roll and yaw: the rates are turned with the flow there; see `_met`.

What the sources' moments do beyond that is theirs. They are quasi-steady: those of the
angles of attack and sideslip may do work of either sign, a glider that is thrown astern
swings round, and moved broadside (u = 0) small angles know no force at all.
"""

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import barrier
from jaxglider.core.rotations import direction
from jaxglider.signals import BodyAxes
from jaxglider.vehicle.parameters import GliderParameters


@jax.named_scope("coriolis")
def coriolis(
    parameters: GliderParameters, velocity: BodyAxes[Scalar]
) -> BodyAxes[Scalar]:
    """C(ν)ν: Coriolis and centripetal force [N] and moment [N m], body frame.

    It does no work: ν · C(ν)ν = 0.

    Args:
        parameters: masses and inertias.
        velocity: ν, body velocity through the water [m/s, rad/s].
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


@jax.named_scope("hydrodynamics")
def hydrodynamics(
    parameters: GliderParameters, velocity: BodyAxes[Scalar]
) -> BodyAxes[Scalar]:
    """D(ν)ν: drag, lift, side force [N] and their moments [N m], body frame.

    Args:
        parameters: hydrodynamic coefficients.
        velocity: ν, body velocity through the water [m/s, rad/s].
    """
    c = parameters
    u, v, w = velocity.surge, velocity.sway, velocity.heave
    p, q, r = velocity.roll, velocity.pitch, velocity.yaw
    speed = jnp.abs(u)
    along, squared = speed * u, u * u
    return BodyAxes(
        c.lift_offset * speed * w - c.drag * along,
        (c.side_force_slope - c.drag) * speed * v,
        -c.lift_offset * along - (c.drag + c.lift_slope) * speed * w,
        c.roll_damping * p * squared + c.roll_moment_slope * speed * v,
        c.pitch_moment_offset * squared
        + c.pitch_damping * q * squared
        + c.pitch_moment_slope * speed * w,
        c.yaw_damping * r * squared + c.yaw_moment_slope * speed * v,
    )


SLOWEST = 1e-6
"""Speed [m/s] below which the flow has no direction: its frame is singular at rest."""


@jax.named_scope("hydrodynamics")
def flow_frame_hydrodynamics(
    parameters: GliderParameters, induced_drag: Scalar, velocity: BodyAxes[Scalar]
) -> BodyAxes[Scalar]:
    """R (−D, SF, −L) and R (T₁, T₂, T₃): force [N] and moment [N m], body frame.

    D = (K_D0 + K_D α²) V², SF = K_β β V², L = (K_L0 + K_L α) V², T₁ = (K_MR β + K_p p)
    V², T₂ = (K_M0 + K_M α + K_q q) V², T₃ = (K_MY β + K_r r) V²; α = atan2(w, u),
    β = asin(v/V), R from the frame of the flow to that of the body; p and r as `_met`.

    Args:
        parameters: hydrodynamic coefficients.
        induced_drag: K_D [kg/m/rad²].
        velocity: ν, body velocity through the water [m/s, rad/s].
    """
    c = parameters
    u, v, w = velocity.surge, velocity.sway, velocity.heave
    p, q, r = velocity.roll, velocity.pitch, velocity.yaw
    ahead = barrier(jnp.sqrt(u * u + w * w + SLOWEST * SLOWEST))
    speed2 = barrier(ahead * ahead + v * v)
    speed = barrier(jnp.sqrt(speed2))
    alpha, beta = barrier(direction(u, w)), barrier(direction(ahead, v))
    cos_a, sin_a, cos_b, sin_b = u / ahead, w / ahead, ahead / speed, v / speed
    p, r = _met(p, r, cos_a, sin_a)

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


def _met(
    roll_rate: Scalar, yaw_rate: Scalar, cos_a: Scalar, sin_a: Scalar
) -> tuple[Scalar, Scalar]:
    """The rates that the damping in the frame of the flow takes for p and r [rad/s].

    p and r themselves as long as the glider moves ahead. Beyond |α| = π/2 they are
    turned by 2 (|α| − π/2) about the y axis, so that R leaves of them what it leaves
    at π − |α|: damping, not drive, and with no step in between.
    """
    back = jnp.minimum(cos_a, 0.0)
    cosine, sine = 1.0 - 2.0 * back * back, -2.0 * back * sin_a
    return cosine * roll_rate + sine * yaw_rate, cosine * yaw_rate - sine * roll_rate
