"""Energy: what pump, moving masses, electronics and calls take from the battery.

E = ∫ P_p dt + e_r |Δr_p1| + e_γ |Δγ| + P_hotel T_u + P_surface T_s + E_call N, with
T_u under water and T_s at the surface.

The pump takes power only while it pushes, out against the pressure: P_p(Z) = P₀ + P₁ Z
at a flow that is known with it, maybe another above some depth. Where the power is not
known it is the work against the pressure over an efficiency, g Z Δm_b/η(Z), with
η = 0.4 Z/1000 m, clipped to [0.08, 0.45], as five dives of a Seaglider to 990 m have
it: electrical power is almost constant, so that the deeper push is the more efficient.

A pump is also an actuator: it runs or it stands, out slower than in.
"""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jaxglider.core.containers import (
    Container,
    Flag,
    Scalar,
    as_float,
    check_interval,
)
from jaxglider.signals import Command
from jaxglider.vehicle.actuators import Actuator


class Pump(Actuator):
    """A buoyancy engine that runs or stands, with rates by direction and depth.

    It stands within its dead band of the command. Pushing lowers m_b.

    Attributes:
        push_rate: rate out [kg/s].
        draw_rate: rate in, through a valve maybe [kg/s].
        boost_rate: rate out above `boost_above` [kg/s], or None for the same.
        boost_above: depth above which the boost pump helps [m].
        dead_band: distance from the command within which it stands [kg].

    Raises:
        ValueError: a rate is not positive.
    """

    push_rate: Scalar = eqx.field(converter=as_float, default=0.01)
    draw_rate: Scalar = eqx.field(converter=as_float, default=0.01)
    boost_rate: Scalar | None = eqx.field(converter=as_float, default=None)
    boost_above: Scalar = eqx.field(converter=as_float, default=120.0)
    dead_band: Scalar = eqx.field(converter=as_float, default=0.0)

    def __check_init__(self) -> None:
        for name in ("push_rate", "draw_rate", "boost_rate"):
            check_interval("Pump", name, getattr(self, name), low=0.0)

    def towards(
        self, target: Scalar, held: Scalar, dt: Scalar, depth: Scalar | float
    ) -> Scalar:
        """The ballast one tick later, at the rate of the depth."""
        push = self.push_rate
        if self.boost_rate is not None:
            push = jnp.where(depth < self.boost_above, self.boost_rate, push)
        moved = jnp.clip(target, held - push * dt, held + self.draw_rate * dt)
        return jnp.where(jnp.abs(target - held) <= self.dead_band, held, moved)


class PumpPower(Container):
    """Electrical power of a pump, and the flow that goes with it.

    Attributes:
        power: P₀ [W].
        slope: P₁ [W/m], growth with depth.
        rate: flow that goes with it, as mass of water [kg/s].

    Raises:
        ValueError: the power is negative or the rate not positive.
    """

    power: Scalar = eqx.field(converter=as_float)
    slope: Scalar = eqx.field(converter=as_float)
    rate: Scalar = eqx.field(converter=as_float)

    def __check_init__(self) -> None:
        check_interval("PumpPower", "power", self.power, 0.0, closed_low=True)
        check_interval("PumpPower", "rate", self.rate, 0.0)

    def per_mass(self, depth: Scalar) -> Scalar:
        """Energy per ballast pushed out at a depth [m] below the surface [J/kg]."""
        return (self.power + self.slope * depth) / self.rate


class Consumers(Container):
    """Energy by who took it [J].

    Attributes:
        pump: energy of the buoyancy engine [J].
        position: energy of the shifts of the moving mass [J].
        steering: energy of its turns, or of the fin [J].
        hotel: energy of computer and sensors under water [J].
        surface: energy of a glider at the surface, calls left out [J].
        communication: energy of the calls [J].
    """

    pump: Scalar
    position: Scalar
    steering: Scalar
    hotel: Scalar
    surface: Scalar
    communication: Scalar

    def total(self) -> Scalar:
        """Sum of all [J]."""
        buoyancy = self.pump + self.position + self.steering
        return buoyancy + self.hotel + self.surface + self.communication


class EnergyModel(Container):
    """Consumption of a glider.

    Attributes:
        pump: power of the pump, or None to reckon with an efficiency.
        boost: power above `boost_above`, or None for the same at every depth.
        boost_above: depth above which `boost` holds [m].
        per_shift: energy per shift of the moving mass along the axis [J/m].
        per_turn: energy per turn of the mass or the fin [J/rad].
        hotel: power of computer and sensors under water [W].
        surface: power at the surface [W].
        call: energy of a surfacing's calls [J].
        battery: energy in the battery at the start [J], or None for no end.

    Raises:
        ValueError: a number is negative, or the battery is empty.
    """

    pump: PumpPower | None = None
    boost: PumpPower | None = None
    boost_above: Scalar = eqx.field(converter=as_float, default=120.0)
    per_shift: Scalar = eqx.field(converter=as_float, default=0.0)
    per_turn: Scalar = eqx.field(converter=as_float, default=0.0)
    hotel: Scalar = eqx.field(converter=as_float, default=0.0)
    surface: Scalar = eqx.field(converter=as_float, default=0.0)
    call: Scalar = eqx.field(converter=as_float, default=0.0)
    battery: Scalar | None = eqx.field(converter=as_float, default=None)

    def __check_init__(self) -> None:
        for name in ("per_shift", "per_turn", "hotel", "surface", "call"):
            value = getattr(self, name)
            check_interval("EnergyModel", name, value, 0.0, closed_low=True)
        check_interval("EnergyModel", "battery", self.battery, 0.0)

    def push(self, mass: Scalar, depth: Scalar, gravity: Scalar) -> Scalar:
        """Energy to push ballast out at a depth [J].

        Args:
            mass: mass of water displaced by it, not negative [kg].
            depth: depth of the glider [m].
            gravity: g [m/s²].
        """
        depth = jnp.maximum(depth, 0.0)
        if self.pump is None:
            efficiency = jnp.clip(0.4e-3 * depth, 0.08, 0.45)
            return mass * gravity * depth / efficiency
        each = self.pump.per_mass(depth)
        if self.boost is not None:
            shallow = self.boost.per_mass(depth)
            each = jnp.where(depth < self.boost_above, shallow, each)
        return mass * each

    def spent(
        self,
        moves: tuple[Command[Scalar], Command[Scalar]],
        depth: Scalar,
        gravity: Scalar,
        stay: tuple[Flag, Flag],
        dt: Scalar,
    ) -> Consumers:
        """Energy of one tick.

        Args:
            moves: positions of the actuators at the start and the end of the tick [kg,
                m, rad]; between them each has gone one way.
            depth: depth of the glider [m].
            gravity: g [m/s²].
            stay: flags, the glider is at the surface, and has just come there.
            dt: tick [s].
        """
        before, after = moves
        surfaced, arrived = stay
        pushed = jnp.maximum(before.buoyancy_mass - after.buoyancy_mass, 0.0)
        shift = jnp.abs(after.mass_position - before.mass_position)
        turn = jnp.abs(after.mass_angle - before.mass_angle)
        return Consumers(
            pump=self.push(pushed, depth, gravity),
            position=self.per_shift * shift,
            steering=self.per_turn * turn,
            hotel=jnp.where(surfaced, 0.0, self.hotel * dt),
            surface=jnp.where(surfaced, self.surface * dt, 0.0),
            communication=jnp.where(arrived, self.call, 0.0 * dt),
        )


def energy_of(values: Mapping[str, float]) -> EnergyModel:
    """The consumption from the numbers of a vehicle's file.

    Args:
        values: numbers by key: fields of `EnergyModel`, those of its pumps by
            `pump_power`, `pump_power_slope` and `pump_rate`, and by `boost_` likewise.

    Raises:
        ValueError: names a number of a pump that is missing beside another of it.
    """
    names = EnergyModel.__dataclass_fields__
    model: dict[str, Any] = {key: values[key] for key in values if key in names}
    for name in ("pump", "boost"):
        keys = [f"{name}_{part}" for part in ("power", "power_slope", "rate")]
        found = [key for key in keys if key in values]
        if not found:
            continue
        missing = [key for key in keys if key not in values]
        if missing:
            raise ValueError(f"energy.{missing[0]} must be given with {found[0]}.")
        model[name] = PumpPower(*(values[key] for key in keys))
    return EnergyModel(**model)
