"""Design model of controller and observer: η'' = f + g U + h d, control-affine.

Source: Yang and Mahmoudian, compact form of the equations of motion. f = J' ν +
J M⁻¹(Cν + Dν + E), g = J M⁻¹ B, h = J M⁻¹, with the parameters the designer has, and
with B evaluated at the mass angle applied in the previous tick.

Deviation: the control law prints d̂ where h d̂ is meant, d̂ having six components.
"""

import equinox as eqx
import jax

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import solve_symmetric
from jaxglider.core.rotations import Attitude, euler_rates
from jaxglider.signals import BodyAxes, Channels, Command, GliderState, Measurement
from jaxglider.vehicle.hydrodynamics import coriolis, hydrodynamics
from jaxglider.vehicle.moving_mass import AbstractActuation
from jaxglider.vehicle.parameters import GliderParameters


class InputGain(eqx.Module):
    """g = J M⁻¹ B: the entries that are not zero, named by output and input.

    Only the buoyancy mass moves the depth directly.
    """

    depth_buoyancy: Scalar
    pitch_buoyancy: Scalar
    pitch_position: Scalar
    pitch_angle: Scalar
    heading_buoyancy: Scalar
    heading_position: Scalar
    heading_angle: Scalar

    def response(self, command: Command[Scalar]) -> Channels[Scalar]:
        """g U: what a command adds to the output acceleration [m/s², rad/s²]."""
        mass, position, angle = (
            command.buoyancy_mass,
            command.mass_position,
            command.mass_angle,
        )
        return Channels(
            self.depth_buoyancy * mass,
            self.pitch_buoyancy * mass
            + self.pitch_position * position
            + self.pitch_angle * angle,
            self.heading_buoyancy * mass
            + self.heading_position * position
            + self.heading_angle * angle,
        )

    def solve(
        self, demand: Channels[Scalar], damping: Command[Scalar]
    ) -> Command[Scalar]:
        """U = (gᵀg + diag(damping))⁻¹ gᵀ demand.

        g is singular at θ = 0 with φ = 0, where every dive starts: hence the damping.

        Args:
            demand: wanted g U [m/s², rad/s²].
            damping: damping, one positive number per actuator.
        """
        g00 = self.depth_buoyancy
        g10, g11, g12 = self.pitch_buoyancy, self.pitch_position, self.pitch_angle
        g20, g21, g22 = self.heading_buoyancy, self.heading_position, self.heading_angle
        r0, r1, r2 = demand.depth, demand.pitch, demand.heading
        return Command(
            *solve_symmetric(
                (
                    g00 * g00 + g10 * g10 + g20 * g20 + damping.buoyancy_mass,
                    g11 * g11 + g21 * g21 + damping.mass_position,
                    g12 * g12 + g22 * g22 + damping.mass_angle,
                ),
                (g10 * g11 + g20 * g21, g10 * g12 + g20 * g22, g11 * g12 + g21 * g22),
                (
                    g00 * r0 + g10 * r1 + g20 * r2,
                    g11 * r1 + g21 * r2,
                    g12 * r1 + g22 * r2,
                ),
            )
        )

    def solve_at(
        self,
        buoyancy_mass: Scalar,
        demand: Channels[Scalar],
        damping: Command[Scalar],
    ) -> Command[Scalar]:
        """Position and angle of the moving mass where the ballast is given.

        The same damped least squares for pitch and heading alone; depth is let go.

        Args:
            buoyancy_mass: m_b that somebody else has chosen [kg].
            demand: wanted g U [m/s², rad/s²]; that of the depth is not looked at.
            damping: damping, one positive number per actuator.
        """
        g11, g12 = self.pitch_position, self.pitch_angle
        g21, g22 = self.heading_position, self.heading_angle
        r1 = demand.pitch - self.pitch_buoyancy * buoyancy_mass
        r2 = demand.heading - self.heading_buoyancy * buoyancy_mass
        a = g11 * g11 + g21 * g21 + damping.mass_position
        b = g11 * g12 + g21 * g22
        c = g12 * g12 + g22 * g22 + damping.mass_angle
        p, q = g11 * r1 + g21 * r2, g12 * r1 + g22 * r2
        determinant = a * c - b * b
        return Command(
            buoyancy_mass, (c * p - b * q) / determinant, (a * q - b * p) / determinant
        )

    def position_at(
        self,
        buoyancy_mass: Scalar,
        demand: Channels[Scalar],
        damping: Command[Scalar],
        angle: Scalar,
    ) -> Command[Scalar]:
        """Position of the moving mass where ballast and angle are given.

        Args:
            buoyancy_mass: m_b that somebody else has chosen [kg].
            demand: wanted g U [m/s², rad/s²]; that of the pitch is looked at.
            damping: damping of r_p1.
            angle: γ [rad].
        """
        g10, g11, g12 = self.pitch_buoyancy, self.pitch_position, self.pitch_angle
        left = demand.pitch - g10 * buoyancy_mass - g12 * angle
        position = g11 * left / (g11 * g11 + damping.mass_position)
        return Command(buoyancy_mass, position, angle)

    def solve_with_angle(
        self, demand: Channels[Scalar], damping: Command[Scalar], angle: Scalar
    ) -> Command[Scalar]:
        """The same for depth and pitch alone, with γ given.

        Args:
            demand: wanted g U [m/s², rad/s²]; that of the heading is not looked at.
            damping: damping of m_b and r_p1.
            angle: γ [rad].
        """
        g00, g10, g11 = self.depth_buoyancy, self.pitch_buoyancy, self.pitch_position
        r0, r1 = demand.depth, demand.pitch - self.pitch_angle * angle
        a00 = g00 * g00 + g10 * g10 + damping.buoyancy_mass
        a01, a11 = g10 * g11, g11 * g11 + damping.mass_position
        b0, b1 = g00 * r0 + g10 * r1, g11 * r1
        determinant = a00 * a11 - a01 * a01
        return Command(
            (a11 * b0 - a01 * b1) / determinant,
            (a00 * b1 - a01 * b0) / determinant,
            angle,
        )


class DesignModel(eqx.Module):
    """The control-affine model inside a controller or an observer.

    Attributes:
        parameters: parameters as the designer believes them; usually not the truth.
        actuation: family of moving-mass moments, in its control-affine form.
    """

    parameters: GliderParameters
    actuation: AbstractActuation

    def free_force(self, state: GliderState, a: Attitude) -> BodyAxes[Scalar]:
        """C(ν)ν + D(ν)ν + E: force [N] and moment [N m] with the command at zero."""
        nu = state.velocity()
        return (
            coriolis(self.parameters, nu)
            + hydrodynamics(self.parameters, nu)
            + self.actuation.restoring(self.parameters, a)
        )

    def force(
        self, state: GliderState, a: Attitude, command: Command[Scalar]
    ) -> BodyAxes[Scalar]:
        """The same with the command: what the observer expects of one tick."""
        b = self.actuation.effectiveness(self.parameters, a, command.mass_angle)
        return self.free_force(state, a) + b.wrench(command)

    @jax.named_scope("drift")
    def drift(self, measurement: Measurement) -> Channels[Scalar]:
        """f + h d̂: output acceleration [m/s², rad/s²] with the command at zero."""
        s, a = measurement.state, measurement.attitude
        force = self.free_force(s, a) + measurement.disturbance
        acceleration = force / self.parameters.inertia()
        curvature = _frame_acceleration(s, a)
        pitch, heading = _attitude_acceleration(a, acceleration.pitch, acceleration.yaw)
        return Channels(
            curvature.depth
            + _depth_acceleration(
                a, acceleration.surge, acceleration.sway, acceleration.heave
            ),
            curvature.pitch + pitch,
            curvature.heading + heading,
        )

    @jax.named_scope("input_gain")
    def input_gain(self, measurement: Measurement) -> InputGain:
        """g at the measured attitude and the mass angle last applied."""
        a = measurement.attitude
        inertia = self.parameters.inertia()
        b = self.actuation.effectiveness(
            self.parameters, a, measurement.applied.mass_angle
        )
        buoyancy = _attitude_acceleration(
            a, b.pitch_buoyancy / inertia.pitch, b.yaw_buoyancy / inertia.yaw
        )
        position = _attitude_acceleration(
            a, b.pitch_position / inertia.pitch, b.yaw_position / inertia.yaw
        )
        angle = _attitude_acceleration(
            a, b.pitch_angle / inertia.pitch, b.yaw_angle / inertia.yaw
        )
        return InputGain(
            depth_buoyancy=_depth_acceleration(
                a,
                b.surge_buoyancy / inertia.surge,
                b.sway_buoyancy / inertia.sway,
                b.heave_buoyancy / inertia.heave,
            ),
            pitch_buoyancy=buoyancy[0],
            pitch_position=position[0],
            pitch_angle=angle[0],
            heading_buoyancy=buoyancy[1],
            heading_position=position[1],
            heading_angle=angle[1],
        )


def _depth_acceleration(a: Attitude, x: Scalar, y: Scalar, z: Scalar) -> Scalar:
    return a.cos_pitch * (a.sin_roll * y + a.cos_roll * z) - a.sin_pitch * x


def _attitude_acceleration(
    a: Attitude, pitch: Scalar, yaw: Scalar
) -> tuple[Scalar, Scalar]:
    _, pitch_acceleration, heading_acceleration = euler_rates(
        a, 0.0 * pitch, pitch, yaw
    )
    return pitch_acceleration, heading_acceleration


def _frame_acceleration(s: GliderState, a: Attitude) -> Channels[Scalar]:
    """J' ν: output acceleration from the turning of the body frame alone."""
    roll_dot, pitch_dot, heading_dot = euler_rates(
        a, s.roll_rate, s.pitch_rate, s.yaw_rate
    )
    down = a.sin_roll * s.sway + a.cos_roll * s.heave
    across = a.cos_roll * s.sway - a.sin_roll * s.heave
    return Channels(
        a.cos_pitch * (roll_dot * across - pitch_dot * s.surge)
        - a.sin_pitch * pitch_dot * down,
        -roll_dot * heading_dot * a.cos_pitch,
        pitch_dot * (roll_dot + a.sin_pitch * heading_dot) / a.cos_pitch,
    )
