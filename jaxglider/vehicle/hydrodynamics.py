"""Inertial and hydrodynamic forces of the small-angle glider model.

Source: Yang and Mahmoudian, Eqs. for C(ν)ν and D(ν)ν, after Zhang et al. 2013, under
Assumption 1: v, w ≪ u, so V = u, sin α = w/u, sin β = v/u.

Deviation from the printed equations: the last term of row 4 of Dν repeats a pitch
coefficient, −K_M0 u v; the source has none, and it is dropped.
"""

from jaxglider._types import Scalar
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
