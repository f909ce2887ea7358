"""The mass matrix of a glider whose masses are where they are.

Source: Zhang, Yu, Zhang and Zhang, Ocean Engineering 60 (2013) 1-13. A glider is a hull
with its centre of mass off the origin, a moving mass that slides along the body axis
and turns about it, and ballast. Origin: centre of buoyancy.
"""

import equinox as eqx
import jax

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import barrier, sincos
from jaxglider.signals import Command
from jaxglider.vehicle.parameters import BodyParameters, GliderParameters


class MassMatrix(eqx.Module):
    """M = [[diag(m), C], [Cᵀ, J]], symmetric, by its entries that are not zero.

    Attributes:
        surge: m₁ [kg], with water carried along.
        sway: m₂ [kg].
        heave: m₃ [kg].
        c01: C of surge and pitch [kg m].
        c02: C of surge and yaw [kg m].
        c10: C of sway and roll [kg m].
        c12: C of sway and yaw [kg m].
        c20: C of heave and roll [kg m].
        c21: C of heave and pitch [kg m].
        j00: J of roll [kg m²].
        j11: J of pitch [kg m²].
        j22: J of yaw [kg m²].
        j01: J of roll and pitch [kg m²].
        j02: J of roll and yaw [kg m²].
        j12: J of pitch and yaw [kg m²].
        ahead: first moment of the mass along x [kg m]; its weight turns the glider.
        aside: first moment of the mass along y [kg m].
        below: first moment of the mass along z [kg m].
    """

    surge: Scalar
    sway: Scalar
    heave: Scalar
    c01: Scalar
    c02: Scalar
    c10: Scalar
    c12: Scalar
    c20: Scalar
    c21: Scalar
    j00: Scalar
    j11: Scalar
    j22: Scalar
    j01: Scalar
    j02: Scalar
    j12: Scalar
    ahead: Scalar
    aside: Scalar
    below: Scalar


@jax.named_scope("mass_matrix")
def mass_matrix(
    parameters: GliderParameters, body: BodyParameters, command: Command[Scalar]
) -> MassMatrix:
    """M with the moving mass and the ballast where the command has put them.

    The moving mass is at (x_p + r_p1, R_p sin γ, R_p cos γ) and its inertia is turned
    with it. The published γ turns the other way.

    Args:
        parameters: masses and inertias.
        body: places of the masses.
        command: command held by the actuators [kg, m, rad].
    """
    sine, cosine = sincos(command.mass_angle)
    mh, xh, zh = body.hull_mass, body.hull_ahead, body.hull_below
    mp, xp = parameters.moving_mass, body.moving_ahead + command.mass_position
    yp, zp = parameters.mass_offset * sine, parameters.mass_offset * cosine
    mb, xb = body.ballast_mass + command.buoyancy_mass, parameters.buoyancy_position
    upright, flat = body.moving_pitch_inertia, body.moving_yaw_inertia
    ahead, aside = barrier(mh * xh + mp * xp + mb * xb), barrier(mp * yp)
    below = barrier(mh * zh + mp * zp)
    long = mh * xh * xh + mp * xp * xp + mb * xb * xb
    return MassMatrix(
        surge=parameters.surge_mass + command.buoyancy_mass,
        sway=parameters.sway_mass + command.buoyancy_mass,
        heave=parameters.heave_mass + command.buoyancy_mass,
        c01=below,
        c02=-aside,
        c10=-below,
        c12=ahead + body.sway_yaw_coupling,
        c20=aside,
        c21=body.heave_pitch_coupling - ahead,
        j00=parameters.roll_inertia
        + body.moving_roll_inertia
        + mh * zh * zh
        + mp * (yp * yp + zp * zp),
        j11=parameters.pitch_inertia
        + upright * cosine * cosine
        + flat * sine * sine
        + long
        + mh * zh * zh
        + mp * zp * zp,
        j22=parameters.yaw_inertia
        + upright * sine * sine
        + flat * cosine * cosine
        + long
        + mp * yp * yp,
        j01=-mp * xp * yp,
        j02=-mh * xh * zh - mp * xp * zp,
        j12=(flat - upright) * sine * cosine - mp * yp * zp,
        ahead=ahead,
        aside=aside,
        below=below,
    )
