"""Vehicles as TOML: every number stands beside its unit, source and doubt."""

import functools
import tomllib
from collections.abc import Iterable
from dataclasses import fields
from importlib import resources
from pathlib import Path
from typing import Any

from jaxglider.core.toml import file_text, number, refuse_unknown
from jaxglider.signals import Command
from jaxglider.vehicle.energy import energy_of
from jaxglider.vehicle.parameters import (
    BodyParameters,
    Fin,
    GliderParameters,
    VehicleData,
)

VEHICLE_TABLES = (
    *("name", "steering", "parameters", "limits", "rates", "body"),
    *("fin", "pump", "energy", "sensors"),
)
"""Keys at the top of a vehicle's file."""


def vehicle_names() -> list[str]:
    """Names of the vehicles that come with the package."""
    folder = resources.files("jaxglider.vehicle") / "data"
    return sorted(p.name.removesuffix(".toml") for p in folder.iterdir())


def load_vehicle(name_or_path: str | Path) -> VehicleData:
    """Read a vehicle that comes with the package, or a TOML file of the same form.

    Args:
        name_or_path: a name from `vehicle_names`, or the path of a file.

    Raises:
        ValueError: unknown name, unknown or missing parameter, or a bad value.
        OSError: the file cannot be read.
    """
    text, source = vehicle_text(name_or_path), name_or_path
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{source}: not valid TOML: {error}.") from error
    return vehicle_of(data, source)


def vehicle_of(data: dict[str, Any], source: str | Path) -> VehicleData:
    """A vehicle from the tables of its file.

    Args:
        data: parsed TOML.
        source: origin of the text, for messages.

    Raises:
        ValueError: unknown or missing parameter, or a bad value.
    """
    tables = {
        "parameters": GliderParameters,
        "limits": Command,
        "rates": Command,
        "body": BodyParameters,
    }
    for optional in ("rates", "body"):
        if optional not in data:
            del tables[optional]
    try:
        others = [key for key in data if key not in VEHICLE_TABLES]
        refuse_unknown(others, list(VEHICLE_TABLES), "")
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from error
    name = data.get("name", str(source))
    if not isinstance(name, str):
        raise ValueError(f"{source}: name must be text; received {name!r}.")
    values = {key: _values(data, key, kind, source) for key, kind in tables.items()}
    steering = _steering(data, source)
    extra = {
        key: _values(data, key, tuple(_OWN_UNITS[key]), source, needed)
        for key, needed in _NEEDED.items()
        if key in data
    }
    deviations = _deviations(data, tables, source)
    try:
        return VehicleData(
            name=name,
            parameters=GliderParameters(**values["parameters"]),
            limits=Command(**values["limits"]),
            body=BodyParameters(**values["body"]) if "body" in values else None,
            rates=Command(**values["rates"]) if "rates" in values else None,
            doubts=_doubts(data, (*tables, *extra)),
            fin=Fin(**extra["fin"]) if steering == "fin" else None,
            pump=extra.get("pump", {}),
            energy=energy_of(extra["energy"]) if "energy" in extra else None,
            deviations=deviations,
            sensors=_table(data, "sensors"),
        )
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from error


def vehicle_text(name_or_path: str | Path) -> str:
    """The file of a vehicle: unit, source and doubt beside each number.

    Raises:
        ValueError: unknown name.
        OSError: the file cannot be read.
    """
    if str(name_or_path) in vehicle_names():
        folder = resources.files("jaxglider.vehicle") / "data"
        return (folder / f"{name_or_path}.toml").read_text(encoding="utf-8")
    if Path(name_or_path).suffix == ".toml":
        return file_text(name_or_path)
    raise ValueError(
        f"vehicle must be one of {vehicle_names()} or the path of a .toml file; "
        f"received {str(name_or_path)!r}."
    )


def _table(data: dict[str, Any], key: str) -> dict[str, Any]:
    """A table of the file as it stands there, empty if it is not.

    Raises:
        ValueError: it is no table.
    """
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise ValueError(f"{key} must be a table; received {table!r}.")
    return table


def _doubts(data: dict[str, Any], tables: Iterable[str]) -> dict[str, str]:
    """Doubts that the file expresses, by key."""
    return {
        f"{table}.{key}": str(entry["doubt"])
        for table in tables
        for key, entry in data[table].items()
        if isinstance(entry, dict) and "doubt" in entry
    }


def _steering(data: dict[str, Any], source: str | Path) -> str:
    """The way of steering: `mass-angle` or `fin`.

    Raises:
        ValueError: another word, or a fin that is not described.
    """
    word = data.get("steering", "mass-angle")
    if word not in ("mass-angle", "fin"):
        raise ValueError(
            f'{source}: steering must be "mass-angle" or "fin"; received {word!r}.'
        )
    if (word == "fin") != ("fin" in data):
        raise ValueError(
            f'{source}: steering = "fin" and a table [fin] go together; '
            f"received steering = {word!r} {'with' if 'fin' in data else 'without'} it."
        )
    return str(word)


_NEEDED: dict[str, tuple[str, ...]] = {
    "fin": ("side_force", "yaw_moment", "speed"),
    "pump": ("push_rate", "draw_rate"),
    "energy": (),
}
"""Tables that a vehicle may have, and the keys that each must have."""
_OWN_UNITS = {
    "fin": dict(side_force="kg/m/rad", yaw_moment="kg/rad", speed="m/s"),
    "pump": {
        **dict.fromkeys(("push_rate", "draw_rate", "boost_rate"), "kg/s"),
        "boost_above": "m",
        "dead_band": "kg",
    },
    "energy": {
        **dict.fromkeys(("pump_power", "boost_power", "hotel", "surface"), "W"),
        **dict.fromkeys(("pump_power_slope", "boost_power_slope"), "W/m"),
        **dict.fromkeys(("pump_rate", "boost_rate"), "kg/s"),
        **{"boost_above": "m", "per_shift": "J/m", "per_turn": "J/rad"},
        **{"call": "J", "battery": "J"},
    },
}
"""Units of the keys of these tables."""


def _deviations(
    data: dict[str, Any], tables: Iterable[str], source: str | Path
) -> dict[str, float]:
    """Standard deviations that the file states, by key.

    Raises:
        ValueError: one is no positive number.
    """
    found = {}
    for table in tables:
        for key, entry in data[table].items():
            if isinstance(entry, dict) and "standard_deviation" in entry:
                where = f"{source}: {table}.{key}: standard_deviation"
                value = number(entry["standard_deviation"], where)
                if value <= 0.0:
                    raise ValueError(f"{where} must be positive; received {value:g}.")
                found[f"{table}.{key}"] = value
    return found


def _values(
    data: dict[str, Any],
    table: str,
    kind: Any,
    source: str | Path,
    needed: tuple[str, ...] | None = None,
) -> dict[str, float]:
    """Numbers of a table.

    Args:
        data: parsed TOML.
        table: name of the table.
        kind: class whose fields are its keys, or the keys.
        source: origin of the text, for messages.
        needed: keys that it must have; all by default.

    Raises:
        ValueError: unknown or missing key, or a bad value.
    """
    names = list(kind) if isinstance(kind, tuple) else [f.name for f in fields(kind)]
    entries = data.get(table, {})
    if not isinstance(entries, dict):
        raise ValueError(f"{source}: {table} must be a table; received {entries!r}.")
    try:
        refuse_unknown([key for key in entries if key not in names], names, table)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from error
    required = names if needed is None else needed
    missing = [name for name in required if name not in entries]
    if missing:
        raise ValueError(f"{source}: key {table}.{missing[0]} is missing.")
    values = {}
    for key, entry in entries.items():
        value = entry.get("value") if isinstance(entry, dict) else entry
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(
                f"{source}: {table}.{key} must be a number or a table with `value`; "
                f"received {entry!r}."
            )
        values[key] = number(value, f"{source}: {table}.{key}")
        if isinstance(entry, dict) and "unit" in entry:
            _check_unit(entry["unit"], f"{table}.{key}", source)
    return values


def _check_unit(unit: Any, key: str, source: str | Path) -> None:
    """Refuse a unit other than that of the key: no number is converted.

    Raises:
        ValueError: names the key, its unit and the one received.
    """
    wanted = key_units()[key]
    if not isinstance(unit, str) or _plain(unit) != _plain(wanted):
        raise ValueError(
            f"{source}: {key} must be in {wanted}, and so must its unit say where it "
            f"has one; received unit = {unit!r}. Convert the value to {wanted}."
        )


@functools.cache
def key_units() -> dict[str, str]:
    """Unit of each key, as the vehicles of the package have it."""
    data = tomllib.loads(vehicle_text("seawing"))
    own = {
        f"{table}.{key}": unit
        for table, units in _OWN_UNITS.items()
        for key, unit in units.items()
    }
    return own | {
        f"{table}.{key}": entry["unit"]
        for table in ("parameters", "limits", "rates", "body")
        for key, entry in data[table].items()
    }


def _plain(unit: str) -> str:
    """A unit without the marks that are written in several ways."""
    for mark, word in (("²", "^2"), ("**", "^"), ("·", " "), ("*", " ")):
        unit = unit.replace(mark, word)
    return " ".join(unit.split())
