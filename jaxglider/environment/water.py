"""Water that moves and is not the same at every depth; optional, for every plant.

The equations of motion hold for the velocity through the water, ν_r = ν − Rᵀ v_c, in a
frame that drifts with it. Over ground,

ν' = ν_r' − ω × Rᵀ v_c + Rᵀ v_c',   v_c' = ∂v_c/∂t + Z' ∂v_c/∂Z.

Left out: the pressure that accelerates the water and would push on a net weight, a
share m_b/m of v_c'. Controllers know the velocity through the water, as a model on
board or a Doppler log on the water around tells it; nothing down there tells the one
over ground.

Water that grows denser with depth lifts a glider; a hull that is squeezed sinks it. The
displaced mass is m (1 + ε z)(1 − κ z) at z below neutral depth.
"""

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core import rotations as frames
from jaxglider.core.containers import Container, Scalar, as_float, check_interval
from jaxglider.core.numerics import sincos
from jaxglider.environment.tables import CurrentTable, DensityProfile
from jaxglider.signals import BodyAxes, Command, GliderState
from jaxglider.vehicle.plant import AbstractPlant


def _number(default: float = 0.0) -> Any:
    return eqx.field(converter=as_float, default=default)


class Current(Container):
    """Horizontal velocity of the water: v₀ + s Z + a sin(2π t/T + φ₀), north and east.

    A table of an ocean model is added where there is one.

    Attributes:
        north: velocity to the north at the surface [m/s].
        east: velocity to the east at the surface [m/s].
        shear_north: change of the northward velocity with depth [1/s].
        shear_east: change of the eastward velocity with depth [1/s].
        tide_north: amplitude of the northward tide [m/s].
        tide_east: amplitude of the eastward tide [m/s].
        tide_period: T, period of the tide [s].
        tide_phase: φ₀, phase of the tide at time zero [rad].
        table: velocities over time and depth, or None.

    Raises:
        ValueError: the period is not positive.
    """

    north: Scalar = _number()
    east: Scalar = _number()
    shear_north: Scalar = _number()
    shear_east: Scalar = _number()
    tide_north: Scalar = _number()
    tide_east: Scalar = _number()
    tide_period: Scalar = _number(44712.0)
    tide_phase: Scalar = _number()
    table: CurrentTable | None = None

    def __check_init__(self) -> None:
        check_interval("Current", "tide_period", self.tide_period, 0.0)

    def velocity(self, depth: Scalar, time: Scalar) -> tuple[Scalar, Scalar]:
        """North and east [m/s] at a depth [m] and a time [s].

        Args:
            depth: Z [m], positive down.
            time: present time [s].
        """
        wave, _ = sincos(2.0 * math.pi * time / self.tide_period + self.tide_phase)
        north = self.north + self.shear_north * depth + self.tide_north * wave
        east = self.east + self.shear_east * depth + self.tide_east * wave
        if self.table is None:
            return north, east
        more_north, more_east = self.table.velocity(depth, time)
        return north + more_north, east + more_east


class Stratification(Container):
    """Effect of depth on buoyancy.

    Attributes:
        displaced_mass: m, mass of the water that the glider displaces [kg].
        density_gradient: ε [1/m], relative growth of the density with depth.
        hull_compressibility: κ [1/m], relative loss of volume with depth.
        neutral_depth: depth at which m_b = 0 is neutral [m].
        profile: density over depth, which the gradient is added to, or None.

    Raises:
        ValueError: the displaced mass is not positive.
    """

    displaced_mass: Scalar = eqx.field(converter=as_float)
    density_gradient: Scalar = _number()
    hull_compressibility: Scalar = _number()
    neutral_depth: Scalar = _number()
    profile: DensityProfile | None = None

    def __check_init__(self) -> None:
        check_interval("Stratification", "displaced_mass", self.displaced_mass, 0.0)

    def denser(self, depth: Scalar) -> Scalar:
        """Density at a depth [m] relative to that at neutral depth, less one."""
        dense = self.density_gradient * (depth - self.neutral_depth)
        if self.profile is None:
            return dense
        return dense + self.profile.excess(depth, self.neutral_depth)

    def excess_mass(self, depth: Scalar) -> Scalar:
        """Mass that the glider is heavier at a depth [m] than at neutral depth [kg]."""
        dense = self.denser(depth)
        squeezed = self.hull_compressibility * (depth - self.neutral_depth)
        return self.displaced_mass * (squeezed - dense + dense * squeezed)


class Water(Container):
    """The water around a glider.

    Attributes:
        current: current, or None for water at rest.
        stratification: effect of depth on buoyancy, or None for none.
    """

    current: Current | None = None
    stratification: Stratification | None = None


def current_at(
    water: Water | None, depth: Scalar, time: Scalar
) -> tuple[Scalar, Scalar]:
    """Velocity of the water, north and east [m/s]; zero where it rests.

    Args:
        water: water around the glider, or None.
        depth: depth of the glider [m].
        time: present time [s].
    """
    if water is None or water.current is None:
        zero = jnp.zeros_like(depth)
        return zero, zero
    return water.current.velocity(depth, time)


def through_water(state: GliderState, current: tuple[Scalar, Scalar]) -> GliderState:
    """The state with its velocity through the water in place of that over ground.

    Args:
        state: state over ground.
        current: velocity of the water, north and east [m/s].
    """
    north, east = current
    x, y, z = frames.ned_to_body(state.attitude(), north, east, 0.0 * north)
    return dataclasses.replace(
        state, surge=state.surge - x, sway=state.sway - y, heave=state.heave - z
    )


def relative_to_water(
    water: Water | None, state: GliderState, time: Scalar
) -> tuple[GliderState, tuple[Scalar, Scalar] | None]:
    """The state with its velocity through the water, and the velocity of the water.

    Args:
        water: water around the glider, or None.
        state: state over ground.
        time: present time [s].

    Returns:
        The state, and north and east of the current [m/s]; in water without a current
        the state as it is, and None.
    """
    if water is None or water.current is None:
        return state, None
    current = water.current.velocity(state.depth, time)
    return through_water(state, current), current


def derivative_in_water(
    plant: AbstractPlant,
    water: Water,
    state: GliderState,
    command: Command[Scalar],
    disturbance: BodyAxes[Scalar],
    time: Scalar,
) -> GliderState:
    """Time derivative of the state over ground.

    Args:
        plant: the glider.
        water: water around it.
        state: state over ground.
        command: command held by the actuators [kg, m, rad].
        disturbance: τ_d, force [N] and moment [N m], body frame.
        time: present time [s].
    """
    a = state.attitude()
    if water.stratification is not None:
        with jax.named_scope("stratification"):
            excess = water.stratification.excess_mass(state.depth)
            pull = plant.parameters.gravity * excess
            zero = jnp.zeros_like(pull)
            disturbance = disturbance + BodyAxes(
                *frames.ned_to_body(a, zero, zero, pull), zero, zero, zero
            )
    if water.current is None:
        return plant.derivative(state, command, disturbance)
    return _drifting(plant, water.current, state, a, command, disturbance, time)


@jax.named_scope("current")
def _drifting(
    plant: AbstractPlant,
    current: Current,
    state: GliderState,
    a: frames.Attitude,
    command: Command[Scalar],
    disturbance: BodyAxes[Scalar],
    time: Scalar,
) -> GliderState:
    """The rates in the frame that drifts, and what they are over ground."""
    _, _, sinking = frames.body_to_ned(a, state.surge, state.sway, state.heave)
    (north, east), (north_rate, east_rate) = jax.jvp(
        current.velocity, (state.depth, time), (sinking, jnp.ones_like(time))
    )
    zero = jnp.zeros_like(north)
    x, y, z = frames.ned_to_body(a, north, east, zero)
    ahead, aside, down = frames.ned_to_body(a, north_rate, east_rate, zero)
    p, q, r = state.roll_rate, state.pitch_rate, state.yaw_rate
    relative = dataclasses.replace(
        state, surge=state.surge - x, sway=state.sway - y, heave=state.heave - z
    )
    rate = plant.derivative(relative, command, disturbance)
    return dataclasses.replace(
        rate,
        north=rate.north + north,
        east=rate.east + east,
        surge=rate.surge + ahead - (q * z - r * y),
        sway=rate.sway + aside - (r * x - p * z),
        heave=rate.heave + down - (p * y - q * x),
    )
