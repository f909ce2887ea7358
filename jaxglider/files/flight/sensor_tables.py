"""Tables of the sensors on board, and the sets of them that come with the package.

A mission that has a table `sensors` is flown by what they show. What it leaves out is
that of the set it names, or of the vehicle's file, or of the set of a Slocum.
"""

import math
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from jaxglider.core.toml import ConfigError, TomlTable, choice, read_toml
from jaxglider.files.flight.yo_tables import built
from jaxglider.navigation.reckoning import Reckoning
from jaxglider.navigation.sensing.altimeter import Altimeter
from jaxglider.navigation.sensing.instrument import Compass, Instrument
from jaxglider.navigation.sensing.positioning import Positioning
from jaxglider.navigation.sensing.readings import Instruments, Sensed
from jaxglider.vehicle.full_plant import FullPlant
from jaxglider.vehicle.parameters import VehicleData
from jaxglider.vehicle.plant import AbstractPlant

DEGREE = math.pi / 180.0
_UNITS = {"m": 1.0, "deg": DEGREE, "s": 1.0, "": 1.0}
_COMMON = {
    "period": "s",
    "latency": "s",
    "noise": "",
    "bias": "",
    "bias_deviation": "",
    "quantum": "",
}
"""Fields of `Instrument` with a unit: their own, or none for that of the quantity."""
_OWN = {
    "depth": (Instrument, "m", {}),
    "roll": (Instrument, "deg", {}),
    "pitch": (Instrument, "deg", {}),
    "heading": (Compass, "deg", {"once": "deg", "twice": "deg"}),
    "altimeter": (
        Altimeter,
        "m",
        {
            **dict.fromkeys(("nearest", "farthest", "least_depth"), "m"),
            **dict.fromkeys(("cone", "lean"), "deg"),
        },
    ),
}
"""Class, unit and further fields of each sensor but the receiver."""
_GPS = {"first_fix": "s", "period": "s", "noise": "m", "depth": "m"}
ABSENT = "none"
"""Value of a sensor's key that takes the sensor off the glider."""


def sensor_sets() -> list[str]:
    """Names of the sets of sensors that come with the package."""
    return sorted(path.stem for path in _folder().glob("*.toml"))


def _folder() -> Path:
    return Path(str(resources.files("jaxglider.files.flight") / "sensors"))


def read_sensors(
    table: TomlTable | None, vehicle: Mapping[str, Any]
) -> Instruments | None:
    """The sensors of a mission; None where it has no table of them.

    Args:
        table: table of the mission, or None.
        vehicle: table `sensors` of the vehicle's file, empty if it has none.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    if table is None:
        return None
    named = table.get("set", None)
    above: Mapping[str, Any] = {} if named is not None else vehicle
    name = str(above.get("set", "slocum")) if named is None else table.text("set")
    choice(name, dict.fromkeys(sensor_sets()), table.where("set"))
    given = {key: value for key, value in above.items() if key != "set"}
    whole = _over(read_toml(_folder() / f"{name}.toml"), given)
    own = table.rest()
    merged = TomlTable(_over(whole, own), table.where("")[:-1])
    parts = {key: _sensor(merged, key) for key in _OWN}
    receiver = _receiver(merged)
    merged.close()
    missing = [key for key in Sensed.__dataclass_fields__ if parts[key] is None]
    if missing:
        raise ConfigError(
            f"{table.where(missing[0])} must be a table: no glider flies without it; "
            f'received "{ABSENT}".'
        )
    altimeter = parts.pop("altimeter")
    return Instruments(Sensed(**parts), altimeter, receiver)


def read_reckoning(
    instruments: Instruments | None, plant: AbstractPlant, vehicle: VehicleData
) -> Reckoning | None:
    """Dead reckoning with the polar of the vehicle, which its pilots know.

    Args:
        instruments: sensors, or None: then nothing is reckoned.
        plant: glider that is flown.
        vehicle: vehicle that it is.
    """
    if instruments is None:
        return None
    body = vehicle.body
    induced = body.induced_drag if isinstance(plant, FullPlant) and body else 0.0
    return Reckoning(plant.parameters, induced)


def _over(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Tables with the numbers of others in place of theirs."""
    merged = dict(below)
    for key, value in above.items():
        old = merged.get(key)
        both = isinstance(value, dict) and isinstance(old, dict)
        merged[key] = {**old, **value} if both else value  # type: ignore[dict-item]
    return merged


def _sensor(table: TomlTable, name: str) -> Any:
    """One sensor, or None where it is taken off."""
    if table.get(name, None) in (None, ABSENT):
        return None
    kind, unit, further = _OWN[name]
    own = table.table(name)
    values = {}
    for field, of in {**_COMMON, **further}.items():
        word = of or unit
        key = f"{field}_{word}"
        if own.get(key, None) is not None:
            values[field] = _UNITS[word] * own.number(key)
    if own.get("lost", None) is not None:
        values["lost"] = own.number("lost")
    if "period" not in values:
        own.number("period_s")
    where = own.where("")[:-1]
    own.close()
    return built(kind, where, **values)


def _receiver(table: TomlTable) -> Positioning | None:
    if table.get("gps", None) in (None, ABSENT):
        return None
    own = table.table("gps")
    values = {
        field: own.number(f"{field}_{unit}")
        for field, unit in _GPS.items()
        if own.get(f"{field}_{unit}", None) is not None
    }
    where = own.where("")[:-1]
    own.close()
    receiver: Positioning = built(Positioning, where, **values)
    return receiver
