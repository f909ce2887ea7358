"""A mission with its places on Earth in metres, and its files of the sea inside.

`initial_state.latitude_deg` and `longitude_deg` say where north 0, east 0 is. Then a
course may be given by latitudes and longitudes, or by the file of another program, and
the water by files. All of this is done on the tables, before they are read: what reads
them knows metres alone, and a mission made whole needs no file.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.core.toml import ConfigError, TomlTable
from jaxglider.files.sea.current_files import read_currents
from jaxglider.files.sea.density_files import read_profile
from jaxglider.files.sea.moment import Moment, started
from jaxglider.files.sea.places import Plane, checked, within
from jaxglider.files.sea.seabed_files import read_seabed_grid
from jaxglider.files.sea.waypoint_files import read_waypoints

Tables = dict[str, Any]


def with_sea_inside(data: Tables, folder: Path) -> Tables:
    """Tables of a mission that name no place on Earth but the start, and no file of it.

    Args:
        data: tables of the mission; left as they are.
        folder: folder that paths are relative to.

    Raises:
        ConfigError: names the key, the rule and the value.
    """
    plane = plane_of(data)
    data = dict(data)
    _replace(data, ("reference", "waypoints"), lambda t: _course(t, plane, folder))
    moment = Moment(plane, started(data), _reach(data))

    def put(
        keys: tuple[str, ...], key: str, read: Callable[[Path, Moment], Tables]
    ) -> None:
        where = ".".join(keys)

        def inside(table: Tables) -> Tables:
            if "file" not in table:
                return table
            if key in table:
                raise ConfigError(
                    f"{where}.{key} and {where}.file are both given; give one."
                )
            rest = {name: value for name, value in table.items() if name != "file"}
            return rest | {key: read(_path(table["file"], where, folder), moment)}

        _replace(data, keys, inside)

    put(("water", "stratification"), "profile", read_profile)
    put(("water", "current"), "table", read_currents)
    put(("seabed",), "grid", read_seabed_grid)
    return data


def plane_of(data: Tables) -> Plane | None:
    """The plane around the start; None where the mission is nowhere on Earth.

    Args:
        data: tables of the mission.

    Raises:
        ConfigError: one of the two is missing, no place, or metres are given too.
    """
    start = data.get("initial_state")
    if not isinstance(start, dict):
        return None
    keys = [key for key in ("latitude_deg", "longitude_deg") if key in start]
    if not keys:
        return None
    table = TomlTable(start, "initial_state")
    latitude, longitude = table.number("latitude_deg"), table.number("longitude_deg")
    metres = [key for key in ("north_m", "east_m") if start.get(key, 0.0) != 0.0]
    if metres:
        raise ConfigError(
            f"initial_state.{metres[0]} and {keys[0]} are both given: latitude and "
            "longitude are those of the start, from where metres count."
        )
    return Plane(*checked(latitude, longitude, "initial_state"))


def _replace(
    data: Tables, keys: tuple[str, ...], change: Callable[[Tables], Tables]
) -> None:
    """Change a table, and copy those that it is in; nothing where there is none."""
    above = data
    for key in keys[:-1]:
        if not isinstance(above.get(key), dict):
            return
        above[key] = dict(above[key])
        above = above[key]
    if isinstance(above.get(keys[-1]), dict):
        above[keys[-1]] = change(above[keys[-1]])


def _reach(data: Tables) -> float:
    """Distance from the start that a mission may come to [m]: 10 km beyond it."""
    reference = data.get("reference")
    course = reference.get("waypoints") if isinstance(reference, dict) else None
    if not isinstance(course, dict):
        return Moment.reach
    try:
        places = np.hypot(course["north_m"], course["east_m"])
        return max(float(np.max(places)) + 10e3, Moment.reach)
    except (KeyError, TypeError, ValueError):
        return Moment.reach  # what reads the course complains of it


def _path(value: Any, where: str, folder: Path) -> Path:
    if not isinstance(value, str):
        raise ConfigError(f"{where}.file must be a path as text; received {value!r}.")
    return folder / value


def _course(table: Tables, plane: Plane | None, folder: Path) -> Tables:
    """A table of waypoints in metres."""
    where = "reference.waypoints"
    given = [key for key in ("file", "latitude_deg", "longitude_deg") if key in table]
    if not given:
        return table
    for key in ("north_m", "east_m"):
        if key in table:
            raise ConfigError(f"{where}.{key} and {given[0]} are both given; give one.")
    if plane is None:
        raise ConfigError(
            f"{where}.{given[0]} needs initial_state.latitude_deg and longitude_deg: "
            "where the glider starts."
        )
    if "file" in given:
        if len(given) > 1:
            raise ConfigError(f"{where}.file and {given[1]} are both given; give one.")
        path = _path(table["file"], where, folder)
        places, where = read_waypoints(path), str(path)
    else:
        own = TomlTable(table, where)
        latitudes = own.numbers("latitude_deg")
        longitudes = own.numbers("longitude_deg", length=len(latitudes))
        places = [
            checked(*pair, where) for pair in zip(latitudes, longitudes, strict=True)
        ]
    north, east = plane.metres(*zip(*places, strict=True))
    within(north, east, where)
    rest = {key: value for key, value in table.items() if key not in given}
    return rest | {"north_m": north.tolist(), "east_m": east.tolist()}
