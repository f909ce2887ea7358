"""Force and moment of buoyancy engine and moving mass: B(η, γ) U + E(η).

Source: Yang and Mahmoudian, Eqs. for B and E, with Assumption 2 for the series in γ:
sin γ = γ S(γ), cos γ = 1 + γ C(γ), S = 1 − γ²/6 + γ⁴/120, C = −γ/2 + γ³/24.

Two families. `PrintedActuation` is the paper's B with the sign it prints in row 4. That
sign contradicts row 6 for one and the same mass; `RigidBodyActuation` has the moment
r_p × W that a moving mass must exert, with r_p = (r_p1, R_p sin γ, R_p cos γ).

Deviations from the printed equations, needed by both:

- E row 4 is printed −g cosφ R_p m_p, which would hold the glider at φ = −90°. It is
  −m_p g R_p cosθ sinφ, which rights it.
- B row 6 column 3 is printed with 1 − γ²; the sine series has 1 − γ²/6.
"""

import dataclasses
from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import sincos
from jaxglider.core.rotations import Attitude
from jaxglider.signals import BodyAxes, Command
from jaxglider.vehicle.parameters import GliderParameters


class Effectiveness(eqx.Module):
    """The entries of B that are not zero, named by row and column.

    The buoyancy column is a force per mass [N/kg] and a moment per mass [N m/kg], the
    position column a moment per length [N], the angle column a moment per angle
    [N m/rad]; body frame.
    """

    surge_buoyancy: Scalar
    sway_buoyancy: Scalar
    heave_buoyancy: Scalar
    pitch_buoyancy: Scalar
    yaw_buoyancy: Scalar
    pitch_position: Scalar
    yaw_position: Scalar
    roll_angle: Scalar
    pitch_angle: Scalar
    yaw_angle: Scalar

    def wrench(self, command: Command[Scalar]) -> BodyAxes[Scalar]:
        """B U: force [N] and moment [N m], body frame."""
        mb, rp, gamma = command.buoyancy_mass, command.mass_position, command.mass_angle
        return BodyAxes(
            self.surge_buoyancy * mb,
            self.sway_buoyancy * mb,
            self.heave_buoyancy * mb,
            self.roll_angle * gamma,
            self.pitch_buoyancy * mb
            + self.pitch_position * rp
            + self.pitch_angle * gamma,
            self.yaw_buoyancy * mb + self.yaw_position * rp + self.yaw_angle * gamma,
        )


@jax.named_scope("restoring_moment")
def restoring(
    parameters: GliderParameters, a: Attitude, hull_moment: Scalar | float = 0.0
) -> BodyAxes[Scalar]:
    """E(η): the moment [N m] of the moving mass at rest, hanging below the axis.

    Args:
        parameters: parameters of the glider.
        a: attitude of the glider.
        hull_moment: m_h z_h [kg m] of a hull that hangs below the axis too.
    """
    weight_arm = parameters.gravity * (
        parameters.moving_mass * parameters.mass_offset + hull_moment
    )
    zero = jnp.zeros_like(weight_arm)
    return BodyAxes(
        zero,
        zero,
        zero,
        -weight_arm * a.cos_pitch * a.sin_roll,
        -weight_arm * a.sin_pitch,
        zero,
    )


def _effectiveness(
    parameters: GliderParameters, a: Attitude, gamma: Scalar, row4_sign: float
) -> Effectiveness:
    g, rb = parameters.gravity, parameters.buoyancy_position
    weight = parameters.moving_mass * g
    arm = weight * parameters.mass_offset
    gamma2 = gamma * gamma
    sine = 1.0 - gamma2 / 6.0 + gamma2 * gamma2 / 120.0
    cosine = gamma * (gamma2 / 24.0 - 0.5)
    side, down = a.cos_pitch * a.sin_roll, a.cos_pitch * a.cos_roll
    return Effectiveness(
        surge_buoyancy=-g * a.sin_pitch,
        sway_buoyancy=g * side,
        heave_buoyancy=g * down,
        pitch_buoyancy=-g * rb * down,
        yaw_buoyancy=g * rb * side,
        pitch_position=-weight * down,
        yaw_position=weight * side,
        roll_angle=row4_sign * arm * (down * sine - side * cosine),
        pitch_angle=-arm * a.sin_pitch * cosine,
        yaw_angle=arm * a.sin_pitch * sine,
    )


class AbstractActuation(eqx.Module):
    """A family of moving-mass models."""

    @abstractmethod
    def effectiveness(
        self, parameters: GliderParameters, a: Attitude, gamma: Scalar
    ) -> Effectiveness:
        """B(η, γ): the control-affine form that a design model works with.

        Args:
            parameters: parameters of the glider.
            a: attitude of the glider.
            gamma: γ [rad] that B is evaluated at.
        """

    def restoring(self, parameters: GliderParameters, a: Attitude) -> BodyAxes[Scalar]:
        """E(η): the moment [N m] of everything at rest."""
        return restoring(parameters, a)

    def hull_below_axis(self, parameters: GliderParameters) -> Scalar:
        """m_h z_h [kg m], mass of the hull times depth of its centre of mass."""
        return 0.0 * parameters.mass_offset

    @abstractmethod
    def wrench(
        self, parameters: GliderParameters, a: Attitude, command: Command[Scalar]
    ) -> BodyAxes[Scalar]:
        """Force and moment of the actuators on the true glider, B U + E [N, N m].

        Args:
            parameters: parameters of the glider.
            a: attitude of the glider.
            command: command held by the actuators [kg, m, rad].
        """


class PrintedActuation(AbstractActuation):
    """The paper's B with row 4 as printed: −m_p R_p g cosθ [cosφ S − sinφ C]."""

    def effectiveness(
        self, parameters: GliderParameters, a: Attitude, gamma: Scalar
    ) -> Effectiveness:
        """B(η, γ) as printed."""
        return _effectiveness(parameters, a, gamma, row4_sign=-1.0)

    @jax.named_scope("actuator_wrench")
    def wrench(
        self, parameters: GliderParameters, a: Attitude, command: Command[Scalar]
    ) -> BodyAxes[Scalar]:
        """B(η, γ) U + E(η), series in γ and all."""
        pushed = self.effectiveness(parameters, a, command.mass_angle).wrench(command)
        return pushed + restoring(parameters, a)


class RigidBodyActuation(AbstractActuation):
    """The moment r_p × W of a mass at (r_p1, R_p sin γ, R_p cos γ).

    W = m_p g (−sinθ, cosθ sinφ, cosθ cosφ). At rest the glider hangs at φ = γ.
    """

    def effectiveness(
        self, parameters: GliderParameters, a: Attitude, gamma: Scalar
    ) -> Effectiveness:
        """The same moment in control-affine form, to the accuracy of the series."""
        return _effectiveness(parameters, a, gamma, row4_sign=1.0)

    @jax.named_scope("actuator_wrench")
    def wrench(
        self, parameters: GliderParameters, a: Attitude, command: Command[Scalar]
    ) -> BodyAxes[Scalar]:
        """Buoyancy force and the exact moment of the moving mass."""
        weight = parameters.moving_mass * parameters.gravity
        sine, cosine = sincos(command.mass_angle)
        x = command.mass_position
        y, z = parameters.mass_offset * sine, parameters.mass_offset * cosine
        ahead, side = -weight * a.sin_pitch, weight * a.cos_pitch * a.sin_roll
        down = weight * a.cos_pitch * a.cos_roll
        b = self.effectiveness(parameters, a, command.mass_angle)
        mb = command.buoyancy_mass
        return BodyAxes(
            b.surge_buoyancy * mb,
            b.sway_buoyancy * mb,
            b.heave_buoyancy * mb,
            y * down - z * side,
            z * ahead - x * down + b.pitch_buoyancy * mb,
            x * side - y * ahead + b.yaw_buoyancy * mb,
        )


class BallastedActuation(AbstractActuation):
    """The moment of the moving mass, on a hull whose own centre of mass lies below.

    Attributes:
        hull_moment: m_h z_h [kg m], mass of the hull times depth of its centre.
    """

    hull_moment: Scalar

    def effectiveness(
        self, parameters: GliderParameters, a: Attitude, gamma: Scalar
    ) -> Effectiveness:
        """B(η, γ) of the moving mass; the hull does not move."""
        return _effectiveness(parameters, a, gamma, row4_sign=1.0)

    def hull_below_axis(self, parameters: GliderParameters) -> Scalar:
        """m_h z_h [kg m]."""
        return self.hull_moment

    def restoring(self, parameters: GliderParameters, a: Attitude) -> BodyAxes[Scalar]:
        """E(η) with the hull's share."""
        return restoring(parameters, a, self.hull_moment)

    @jax.named_scope("actuator_wrench")
    def wrench(
        self, parameters: GliderParameters, a: Attitude, command: Command[Scalar]
    ) -> BodyAxes[Scalar]:
        """Buoyancy force and the exact moments of moving mass and hull."""
        moving = RigidBodyActuation().wrench(parameters, a, command)
        return moving + (
            restoring(parameters, a, self.hull_moment) - restoring(parameters, a)
        )


class FinActuation(AbstractActuation):
    """A moving mass that shifts and does not turn, and a fin that steers.

    The third command is the angle δ of the fin, positive to starboard. What the fin
    does depends on the speed; a design model takes it at one.

    Attributes:
        hull_moment: m_h z_h [kg m], mass of the hull times depth of its centre.
        turning: yaw moment per fin angle at that speed [N m/rad].
    """

    hull_moment: Scalar
    turning: Scalar

    def effectiveness(
        self, parameters: GliderParameters, a: Attitude, gamma: Scalar
    ) -> Effectiveness:
        """B(η): that of a mass below the axis, and the fin for its angle."""
        b = _effectiveness(parameters, a, 0.0 * gamma, row4_sign=1.0)
        zero = 0.0 * b.roll_angle
        return dataclasses.replace(
            b, roll_angle=zero, pitch_angle=zero, yaw_angle=zero + self.turning
        )

    def restoring(self, parameters: GliderParameters, a: Attitude) -> BodyAxes[Scalar]:
        """E(η) with the hull's share."""
        return restoring(parameters, a, self.hull_moment)

    def wrench(
        self, parameters: GliderParameters, a: Attitude, command: Command[Scalar]
    ) -> BodyAxes[Scalar]:
        """B(η) U + E(η)."""
        pushed = self.effectiveness(parameters, a, command.mass_angle).wrench(command)
        return pushed + self.restoring(parameters, a)
