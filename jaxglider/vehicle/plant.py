"""The true glider: rates of change of its twelve states.

M ν' = C(ν)ν + D(ν)ν + B(η, γ) U + E(η) + τ_d, and the full Euler kinematics (the paper
gives Z, θ and ψ; X, Y and φ are needed too).
"""

from abc import abstractmethod

import equinox as eqx
import jax

from jaxglider.core import rotations as frames
from jaxglider.core.containers import Scalar
from jaxglider.core.rotations import Attitude
from jaxglider.signals import BodyAxes, Command, GliderState
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.hydrodynamics import coriolis, hydrodynamics
from jaxglider.vehicle.moving_mass import (
    AbstractActuation,
    PrintedActuation,
    RigidBodyActuation,
)
from jaxglider.vehicle.parameters import GliderParameters


class AbstractPlant(eqx.Module):
    """A glider that can be integrated in time.

    Attributes:
        parameters: the true parameters.
    """

    parameters: eqx.AbstractVar[GliderParameters]

    @abstractmethod
    def derivative(
        self,
        state: GliderState,
        command: Command[Scalar],
        disturbance: BodyAxes[Scalar],
    ) -> GliderState:
        """Time derivative of the state.

        Args:
            state: NED position, Euler angles, body velocity.
            command: command held by the actuators [kg, m, rad].
            disturbance: τ_d, external force [N] and moment [N m], body frame.
        """

    @abstractmethod
    def water(self, velocity: BodyAxes[Scalar]) -> BodyAxes[Scalar]:
        """Lift, drag, side force [N] and their moments [N m], body frame."""

    def displaced_mass(self) -> Scalar:
        """m [kg], of the water displaced: m₁ where no more is known."""
        return self.parameters.surge_mass

    @abstractmethod
    def model(self) -> DesignModel:
        """Design model of a designer who knows this glider exactly."""

    @property
    def consistent(self) -> bool:
        """Whether the moving mass rolls the glider as one mass must.

        The printed plant alone is not: its roll moment has the other sign. How far it
        rolls says nothing of a real glider.
        """
        return True


@jax.named_scope("kinematics")
def kinematics(
    state: GliderState, a: Attitude
) -> tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]:
    """J(η) ν: rates of the position in NED [m/s] and of the Euler angles [rad/s].

    Args:
        state: attitude [rad] and body velocity [m/s, rad/s].
        a: sines and cosines of the attitude.
    """
    return (
        *frames.body_to_ned(a, state.surge, state.sway, state.heave),
        *frames.euler_rates(a, state.roll_rate, state.pitch_rate, state.yaw_rate),
    )


class SmallAnglePlant(AbstractPlant):
    """The paper's small-angle glider with one family of moving-mass moments.

    Attributes:
        parameters: the true parameters.
        actuation: printed or rigid-body moments.
    """

    parameters: GliderParameters
    actuation: AbstractActuation

    def force(
        self, state: GliderState, a: Attitude, command: Command[Scalar]
    ) -> BodyAxes[Scalar]:
        """C(ν)ν + D(ν)ν + B U + E: force [N] and moment [N m] without disturbance."""
        nu = state.velocity()
        return (
            coriolis(self.parameters, nu)
            + self.water(nu)
            + self.actuation.wrench(self.parameters, a, command)
        )

    def derivative(
        self,
        state: GliderState,
        command: Command[Scalar],
        disturbance: BodyAxes[Scalar],
    ) -> GliderState:
        """ν' = M⁻¹(force + τ_d) and the Euler kinematics."""
        a = state.attitude()
        acceleration = (
            self.force(state, a, command) + disturbance
        ) / self.parameters.inertia()
        return GliderState(
            *kinematics(state, a),
            *acceleration.fields(),
        )

    def water(self, velocity: BodyAxes[Scalar]) -> BodyAxes[Scalar]:
        """D(ν)ν."""
        return hydrodynamics(self.parameters, velocity)

    @property
    def consistent(self) -> bool:
        """All but the printed moments."""
        return not isinstance(self.actuation, PrintedActuation)

    def model(self) -> DesignModel:
        """The same equations in control-affine form."""
        return DesignModel(self.parameters, self.actuation)


def printed_plant(parameters: GliderParameters) -> SmallAnglePlant:
    """The paper's own glider: the one on which its figures come out again."""
    return SmallAnglePlant(parameters, PrintedActuation())


def rigid_body_plant(parameters: GliderParameters) -> SmallAnglePlant:
    """The glider whose moving mass obeys mechanics: much harder to steer."""
    return SmallAnglePlant(parameters, RigidBodyActuation())
