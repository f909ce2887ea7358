"""The glider that is identified: the product's vehicle, and what only a record has.

Net weight: m − ρ (V (1 − ε p + α_T (T − T₀)) + V_b) in kg, positive sinks, with V_b
the volume of the ballast. Mass and volume are one parameter as far as a flight can
tell, so the volume is given and the mass is fitted. Source: Merckelbach et al., J.
Atmos. Oceanic Technol. 27 (2010) 547-563, and 36 (2019) 281-296.
"""

import dataclasses
from typing import Any

import equinox as eqx

from jaxglider.core.containers import Container, Scalar, as_float
from jaxglider.vehicle.full_plant import FullPlant
from jaxglider.vehicle.parameters import BodyParameters, GliderParameters, VehicleData

TEMPERATURE = 10.0
"""T₀ [°C], at which the volume is that given."""


def _number(default: float = 0.0) -> Any:
    return eqx.field(converter=as_float, default=default)


class RecordParameters(Container):
    """Numbers of the glider that a record shows and a vehicle file has no place for.

    True pitch = pitch_scale × recorded + pitch_offset; r_p1 = recorded position −
    position_offset; roll alike.

    Attributes:
        mass: m [kg], neutral in the water of the record, for the volume given.
        compressibility: ε [1/Pa], of the hull.
        thermal_expansion: α_T [1/K], of the hull.
        pitch_scale: factor on the recorded pitch; other than 1 for a tilted sensor.
        pitch_offset: angle added to the recorded pitch [rad].
        actuator_lag: time [s] by which the actuators act later than their record says.
        position_offset: recorded position of the moving mass that is r_p1 = 0 [m].
        roll_offset: angle added to the recorded roll [rad].
        angle_offset: angle added to the recorded angle of the moving mass [rad].
    """

    mass: Scalar = _number()
    compressibility: Scalar = _number()
    thermal_expansion: Scalar = _number()
    pitch_scale: Scalar = _number(1.0)
    pitch_offset: Scalar = _number()
    actuator_lag: Scalar = _number()
    position_offset: Scalar = _number()
    roll_offset: Scalar = _number()
    angle_offset: Scalar = _number()


class IdentifiedGlider(eqx.Module):
    """A vehicle and the numbers of its record.

    Attributes:
        parameters: parameters of the small-angle equations.
        body: places of the masses.
        record: numbers that only the record shows.
        volume: V [m³], displaced at the surface.
    """

    parameters: GliderParameters
    body: BodyParameters
    record: RecordParameters
    volume: Scalar = eqx.field(converter=as_float)

    def plant(self) -> FullPlant:
        """The glider with six degrees of freedom."""
        return FullPlant(self.parameters, self.body)

    def excess(self, pressure: Any, density: Any, temperature: Any) -> Any:
        """Mass by which the glider is heavier than its water, ballast left out [kg].

        Args:
            pressure: pressure [Pa].
            density: density of the water [kg/m³].
            temperature: temperature [°C].
        """
        r = self.record
        stretched = r.thermal_expansion * (temperature - TEMPERATURE)
        squeezed = 1.0 - r.compressibility * pressure + stretched
        return r.mass - density * self.volume * squeezed

    def true_pitch(self, recorded: Any) -> Any:
        """Pitch [rad] from that of the sensor."""
        return self.record.pitch_scale * recorded + self.record.pitch_offset

    def sensed_pitch(self, pitch: Any) -> Any:
        """Pitch as the sensor would record it [rad]."""
        return (pitch - self.record.pitch_offset) / self.record.pitch_scale


PLACES = {
    **{f.name: "parameters" for f in dataclasses.fields(GliderParameters)},
    **{f.name: "body" for f in dataclasses.fields(BodyParameters)},
    **{f.name: "record" for f in dataclasses.fields(RecordParameters)},
}
"""The part of the glider that each number belongs to, by the number's name."""


def with_values(glider: IdentifiedGlider, values: dict[str, Any]) -> IdentifiedGlider:
    """The glider with some numbers replaced.

    Args:
        glider: glider to start from.
        values: new numbers by name.
    """
    parts = {}
    for part in ("parameters", "body", "record"):
        changes = {n: v for n, v in values.items() if PLACES[n] == part}
        parts[part] = dataclasses.replace(getattr(glider, part), **changes)
    return IdentifiedGlider(volume=glider.volume, **parts)


def value_of(glider: IdentifiedGlider, name: str) -> Any:
    """A number of the glider by its name."""
    return getattr(getattr(glider, PLACES[name]), name)


def resized(vehicle: VehicleData, displaced_mass: float) -> VehicleData:
    """A vehicle of another mass: the hull takes the difference.

    Args:
        vehicle: vehicle to start from.
        displaced_mass: mass of the water that it displaces [kg].

    Raises:
        ValueError: no hull would be left.
    """
    if vehicle.body is None:
        return vehicle
    more = displaced_mass - float(vehicle.body.displaced_mass(vehicle.parameters))
    hull = float(vehicle.body.hull_mass) + more
    if hull <= 0.0:
        raise ValueError(
            f"mass must leave {vehicle.name} a hull: its moving mass and ballast are "
            f"{displaced_mass - hull:g} kg; received {displaced_mass:g}."
        )
    sums = {
        name: getattr(vehicle.parameters, name) + more
        for name in ("surge_mass", "sway_mass", "heave_mass")
    }
    return dataclasses.replace(
        vehicle,
        parameters=dataclasses.replace(vehicle.parameters, **sums),
        body=dataclasses.replace(vehicle.body, hull_mass=hull),
    )
