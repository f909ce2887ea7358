"""Physical parameters of a glider; `files` reads them.

Every number is a traced float: ensembles and gradients go through all of them.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import Container, Scalar, as_float, check_interval
from jaxglider.core.numerics import square_root
from jaxglider.signals import BodyAxes, Command

_POSITIVE = (
    "moving_mass",
    "gravity",
    "surge_mass",
    "sway_mass",
    "heave_mass",
    "roll_inertia",
    "pitch_inertia",
    "yaw_inertia",
)


def _number() -> Any:
    return eqx.field(converter=as_float)


class GliderParameters(Container):
    """Parameters of the small-angle glider model (the paper's table of parameters).

    Masses and inertias include the added terms. Body frame, SI units, radians.

    Attributes:
        moving_mass: m_p [kg].
        mass_offset: R_p [m], distance of the moving mass from the body axis.
        buoyancy_position: r_b [m], of the buoyancy engine along the body axis.
        gravity: g [m/s²].
        surge_mass: m₁ [kg].
        sway_mass: m₂ [kg].
        heave_mass: m₃ [kg].
        roll_inertia: I₁ [kg m²].
        pitch_inertia: I₂ [kg m²].
        yaw_inertia: I₃ [kg m²].
        drag: K_D0 [kg/m].
        lift_offset: K_L0 [kg/m].
        lift_slope: K_L [kg/m/rad].
        side_force_slope: K_β [kg/m/rad].
        roll_moment_slope: K_MR [kg/rad].
        roll_damping: K_p [kg s/rad].
        pitch_moment_offset: K_M0 [kg].
        pitch_moment_slope: K_M [kg/rad].
        pitch_damping: K_q [kg s/rad].
        yaw_moment_slope: K_MY [kg/rad].
        yaw_damping: K_r [kg s/rad].

    Raises:
        ValueError: a mass, an inertia or gravity is not positive, or the drag or the
            mass offset is negative.
    """

    moving_mass: Scalar = _number()
    mass_offset: Scalar = _number()
    buoyancy_position: Scalar = _number()
    gravity: Scalar = _number()
    surge_mass: Scalar = _number()
    sway_mass: Scalar = _number()
    heave_mass: Scalar = _number()
    roll_inertia: Scalar = _number()
    pitch_inertia: Scalar = _number()
    yaw_inertia: Scalar = _number()
    drag: Scalar = _number()
    lift_offset: Scalar = _number()
    lift_slope: Scalar = _number()
    side_force_slope: Scalar = _number()
    roll_moment_slope: Scalar = _number()
    roll_damping: Scalar = _number()
    pitch_moment_offset: Scalar = _number()
    pitch_moment_slope: Scalar = _number()
    pitch_damping: Scalar = _number()
    yaw_moment_slope: Scalar = _number()
    yaw_damping: Scalar = _number()

    def __check_init__(self) -> None:
        for name in _POSITIVE:
            check_interval("GliderParameters", name, getattr(self, name), low=0.0)
        for name in ("drag", "mass_offset"):
            check_interval(
                "GliderParameters", name, getattr(self, name), 0.0, closed_low=True
            )

    def inertia(self) -> BodyAxes[Scalar]:
        """Diagonal of M: masses [kg] and moments of inertia [kg m²]."""
        return BodyAxes(
            self.surge_mass,
            self.sway_mass,
            self.heave_mass,
            self.roll_inertia,
            self.pitch_inertia,
            self.yaw_inertia,
        )

    def scaled(self, factor: float | Scalar) -> "GliderParameters":
        """Parameters of a designer who is wrong by one factor everywhere.

        The paper's "20 % uncertainty" is read as: masses, inertias and hydrodynamic
        coefficients of the design model are `factor` times the true ones; moving mass,
        its offset, the position of the buoyancy engine and gravity are known. (Scaling
        every term of the equation of motion alike would cancel in M⁻¹(...) and leave
        a scaled disturbance only.)
        """
        return dataclasses.replace(
            self, **{name: factor * getattr(self, name) for name in UNCERTAIN}
        )


UNCERTAIN = tuple(
    field.name
    for field in dataclasses.fields(GliderParameters)
    if field.name not in ("moving_mass", "mass_offset", "buoyancy_position", "gravity")
)
"""Names of the parameters that the paper's uncertainty covers: M, I and every K."""


class BodyParameters(Container):
    """Places of the masses, and the coefficients that small angles do not need.

    `GliderParameters` has the sums: m₁ is the mass of hull, moving mass, ballast and
    water carried along in surge, I₁ the inertia of hull and water in roll. This says
    how to take them apart.

    Attributes:
        hull_mass: m_h [kg].
        ballast_mass: m_0 [kg], of the ballast in neutral buoyancy, with its engine.
        hull_ahead: x of the hull's centre of mass [m].
        hull_below: z of the hull's centre of mass [m].
        moving_ahead: x of the moving mass [m] for r_p1 = 0.
        moving_roll_inertia: roll inertia of the moving mass about its own centre [kg
            m²].
        moving_pitch_inertia: pitch inertia of the moving mass for γ = 0 [kg m²].
        moving_yaw_inertia: yaw inertia of the moving mass for γ = 0 [kg m²].
        sway_yaw_coupling: coupling of sway and yaw by added mass [kg m].
        heave_pitch_coupling: coupling of heave and pitch by added mass [kg m].
        induced_drag: K_D [kg/m/rad²].

    Raises:
        ValueError: a mass or an inertia is negative.
    """

    hull_mass: Scalar = _number()
    ballast_mass: Scalar = _number()
    hull_ahead: Scalar = _number()
    hull_below: Scalar = _number()
    moving_ahead: Scalar = _number()
    moving_roll_inertia: Scalar = _number()
    moving_pitch_inertia: Scalar = _number()
    moving_yaw_inertia: Scalar = _number()
    sway_yaw_coupling: Scalar = _number()
    heave_pitch_coupling: Scalar = _number()
    induced_drag: Scalar = _number()

    def __check_init__(self) -> None:
        check_interval("BodyParameters", "hull_mass", self.hull_mass, 0.0)
        for name in (
            "ballast_mass",
            "moving_roll_inertia",
            "moving_pitch_inertia",
            "moving_yaw_inertia",
            "induced_drag",
        ):
            value = getattr(self, name)
            check_interval("BodyParameters", name, value, 0.0, closed_low=True)

    def displaced_mass(self, parameters: GliderParameters) -> Scalar:
        """Mass of the water displaced [kg]: all masses, the ballast neutral."""
        return self.hull_mass + parameters.moving_mass + self.ballast_mass


class Fin(Container):
    """A fin at the tail that steers, δ its angle, positive to starboard.

    Y = K_Yδ δ u V and N = K_Nδ δ u V, for angles at which it does not stall; turned
    round, in a flow from astern, it steers the other way.

    Attributes:
        side_force: K_Yδ [kg/m/rad], negative: a fin at the tail pushes it to port.
        yaw_moment: K_Nδ [kg/rad].
        speed: V [m/s] at which a design model takes its effect.

    Raises:
        ValueError: the speed is not positive.
    """

    side_force: Scalar = _number()
    yaw_moment: Scalar = _number()
    speed: Scalar = eqx.field(converter=as_float, default=0.3)

    def __check_init__(self) -> None:
        check_interval("Fin", "speed", self.speed, 0.0)

    def force(self, velocity: BodyAxes[Scalar], angle: Scalar) -> BodyAxes[Scalar]:
        """Force [N] and moment [N m] of the fin, body frame.

        Args:
            velocity: ν, body velocity through the water [m/s, rad/s].
            angle: δ [rad].
        """
        u, v, w = velocity.surge, velocity.sway, velocity.heave
        pressed = u * square_root(u * u + v * v + w * w) * angle
        zero = jnp.zeros_like(pressed)
        return BodyAxes(
            zero, self.side_force * pressed, zero, zero, zero, self.yaw_moment * pressed
        )


@dataclasses.dataclass(frozen=True)
class VehicleData:
    """A vehicle as published.

    Attributes:
        name: name of the vehicle.
        parameters: parameters of the small-angle equations.
        limits: limits of its actuators [kg, m, rad].
        fin: forces of its fin, or None for one that turns its moving mass to steer.
        pump: rates and dead band of its buoyancy engine by the fields of `Pump`, empty
            where the file does not say.
        energy: `EnergyModel` of the table [energy] of its file, or None.
        body: places of the masses, which the full equations need besides, or None if
            the file does not say.
        rates: largest rates of its actuators [kg/s, m/s, rad/s], or None if the file
            does not say.
        doubts: doubts about the numbers, by their keys.
        deviations: standard deviations of the numbers, where the file says how far
            they may be off, by their keys; in the unit of each.
        sensors: table [sensors] of its file, empty if it has none; the reader of a
            mission reads it.
    """

    name: str
    parameters: GliderParameters
    limits: Command[Scalar]
    body: BodyParameters | None = None
    rates: Command[Scalar] | None = None
    fin: Fin | None = None
    pump: Mapping[str, float] = dataclasses.field(default_factory=dict)
    energy: Any = None
    doubts: Mapping[str, str] = dataclasses.field(default_factory=dict)
    deviations: Mapping[str, float] = dataclasses.field(default_factory=dict)
    sensors: Mapping[str, Any] = dataclasses.field(default_factory=dict)
