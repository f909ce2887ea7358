"""The glider in full: no small angles, masses where they are, inertia that turns.

Source: Zhang, Yu, Zhang and Zhang, Ocean Engineering 60 (2013) 1-13. With momentum
P = m v + C ω and angular momentum K = Cᵀ v + J ω about the centre of buoyancy,

P' = P × ω + F,   K' = K × ω + P × v + T,

F and T from water, weight and disturbance. The paper's equations are what is left of
this for small angles and a diagonal M.

Deviations: the moving parts rest in the body. What they push while they move is left
out, as in the source; their new place counts from the tick on.
"""

import dataclasses

import jax

from jaxglider.core.containers import Scalar
from jaxglider.core.numerics import barrier, solve_symmetric
from jaxglider.core.rotations import Attitude
from jaxglider.signals import BodyAxes, Command, GliderState
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.hydrodynamics import flow_frame_hydrodynamics
from jaxglider.vehicle.mass_matrix import MassMatrix, mass_matrix
from jaxglider.vehicle.moving_mass import (
    AbstractActuation,
    BallastedActuation,
    FinActuation,
)
from jaxglider.vehicle.parameters import (
    BodyParameters,
    Fin,
    GliderParameters,
    VehicleData,
)
from jaxglider.vehicle.plant import AbstractPlant, kinematics


class FullPlant(AbstractPlant):
    """The published glider with six degrees of freedom.

    A glider with a fin steers with it: the third command is the angle of the fin, and
    the moving mass does not turn.

    Attributes:
        parameters: masses, inertias and coefficients, the sums as for small angles.
        body: places of the masses.
        fin: forces of the fin, or None where the mass is turned instead.
    """

    parameters: GliderParameters
    body: BodyParameters
    fin: Fin | None = None

    def derivative(
        self,
        state: GliderState,
        command: Command[Scalar],
        disturbance: BodyAxes[Scalar],
    ) -> GliderState:
        """ν' = M⁻¹ (force + τ_d) and the Euler kinematics."""
        a = state.attitude()
        nu = state.velocity()
        if self.fin is not None:
            disturbance = disturbance + self.fin.force(nu, command.mass_angle)
            level = 0.0 * command.mass_angle
            command = dataclasses.replace(command, mass_angle=level)
        mass = mass_matrix(self.parameters, self.body, command)
        force = (
            momentum_transport(mass, nu)
            + self.water(nu)
            + weight(self.parameters.gravity, mass, a, command.buoyancy_mass)
            + disturbance
        )
        return GliderState(
            *kinematics(state, a),
            *accelerate(mass, force).fields(),
        )

    def water(self, velocity: BodyAxes[Scalar]) -> BodyAxes[Scalar]:
        """Forces and moments in the frame of the flow, turned to the body's."""
        return flow_frame_hydrodynamics(
            self.parameters, self.body.induced_drag, velocity
        )

    def displaced_mass(self) -> Scalar:
        """m [kg], of all masses, the ballast neutral."""
        return self.body.displaced_mass(self.parameters)

    def model(self) -> DesignModel:
        """The diagonal of M at rest, small angles, and the weight of hull and mass."""
        p, body = self.parameters, self.body
        rest = mass_matrix(p, body, Command(*(0.0 * p.gravity,) * 3))
        hull_moment = body.hull_mass * body.hull_below
        actuation: AbstractActuation = BallastedActuation(hull_moment)
        if self.fin is not None:
            turning = self.fin.yaw_moment * self.fin.speed**2
            actuation = FinActuation(hull_moment, turning)
        return DesignModel(
            dataclasses.replace(
                p,
                roll_inertia=rest.j00,
                pitch_inertia=rest.j11,
                yaw_inertia=rest.j22,
            ),
            actuation,
        )


@jax.named_scope("momentum_transport")
def momentum_transport(mass: MassMatrix, nu: BodyAxes[Scalar]) -> BodyAxes[Scalar]:
    """(P × ω, K × ω + P × v): what turning axes do to momentum; it does no work.

    Args:
        mass: mass matrix.
        nu: ν, body velocity [m/s, rad/s].
    """
    m = mass
    u, v, w, p, q, r = nu.fields()
    p1 = barrier(m.surge * u + m.c01 * q + m.c02 * r)
    p2 = barrier(m.sway * v + m.c10 * p + m.c12 * r)
    p3 = barrier(m.heave * w + m.c20 * p + m.c21 * q)
    k1 = barrier(m.c10 * v + m.c20 * w + m.j00 * p + m.j01 * q + m.j02 * r)
    k2 = barrier(m.c01 * u + m.c21 * w + m.j01 * p + m.j11 * q + m.j12 * r)
    k3 = barrier(m.c02 * u + m.c12 * v + m.j02 * p + m.j12 * q + m.j22 * r)
    return BodyAxes(
        p2 * r - p3 * q,
        p3 * p - p1 * r,
        p1 * q - p2 * p,
        k2 * r - k3 * q + p2 * w - p3 * v,
        k3 * p - k1 * r + p3 * u - p1 * w,
        k1 * q - k2 * p + p1 * v - p2 * u,
    )


@jax.named_scope("weight")
def weight(
    gravity: Scalar, mass: MassMatrix, a: Attitude, buoyancy_mass: Scalar
) -> BodyAxes[Scalar]:
    """Weight less buoyancy [N], and the moment of the weight [N m] about its centre.

    Args:
        gravity: g [m/s²].
        mass: mass matrix, with the first moments of the mass.
        a: attitude of the glider.
        buoyancy_mass: m_b [kg].

    Returns:
        Force and moment, body frame.
    """
    x = -gravity * a.sin_pitch
    y = gravity * a.cos_pitch * a.sin_roll
    z = gravity * a.cos_pitch * a.cos_roll
    return BodyAxes(
        buoyancy_mass * x,
        buoyancy_mass * y,
        buoyancy_mass * z,
        mass.aside * z - mass.below * y,
        mass.below * x - mass.ahead * z,
        mass.ahead * y - mass.aside * x,
    )


@jax.named_scope("acceleration")
def accelerate(mass: MassMatrix, force: BodyAxes[Scalar]) -> BodyAxes[Scalar]:
    """M⁻¹ (force, moment) in closed form, through J − Cᵀ diag(m)⁻¹ C.

    Args:
        mass: mass matrix.
        force: force [N] and moment [N m], body frame.
    """
    m = mass
    f1, f2, f3 = force.surge, force.sway, force.heave
    d1, d2, d3 = barrier(1.0 / m.surge), barrier(1.0 / m.sway), barrier(1.0 / m.heave)
    roll, pitch, yaw = solve_symmetric(
        (
            barrier(m.j00 - m.c10 * m.c10 * d2 - m.c20 * m.c20 * d3),
            barrier(m.j11 - m.c01 * m.c01 * d1 - m.c21 * m.c21 * d3),
            barrier(m.j22 - m.c02 * m.c02 * d1 - m.c12 * m.c12 * d2),
        ),
        (
            barrier(m.j01 - m.c20 * m.c21 * d3),
            barrier(m.j02 - m.c10 * m.c12 * d2),
            barrier(m.j12 - m.c01 * m.c02 * d1),
        ),
        (
            barrier(force.roll - m.c10 * f2 * d2 - m.c20 * f3 * d3),
            barrier(force.pitch - m.c01 * f1 * d1 - m.c21 * f3 * d3),
            barrier(force.yaw - m.c02 * f1 * d1 - m.c12 * f2 * d2),
        ),
    )
    return BodyAxes(
        (f1 - m.c01 * pitch - m.c02 * yaw) * d1,
        (f2 - m.c10 * roll - m.c12 * yaw) * d2,
        (f3 - m.c20 * roll - m.c21 * pitch) * d3,
        roll,
        pitch,
        yaw,
    )


def full_plant(vehicle: VehicleData) -> FullPlant:
    """A vehicle in full.

    Raises:
        ValueError: its file does not say where the masses are.
    """
    if vehicle.body is None:
        raise ValueError(
            f"the seawing plant needs a table [body]; {vehicle.name} has none. "
            "`jaxglider vehicles --show seawing` prints one."
        )
    return FullPlant(vehicle.parameters, vehicle.body, vehicle.fin)
