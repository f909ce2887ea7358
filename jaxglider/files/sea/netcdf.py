"""NetCDF files of the sea, looked at from the start of a mission; read by xarray."""

import dataclasses
import datetime
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.core.toml import ConfigError
from jaxglider.files.sea.places import Plane

_NAMES = {
    "latitude": ("latitude", "lat", "nav_lat", "LATITUDE"),
    "longitude": ("longitude", "lon", "nav_lon", "LONGITUDE"),
    "depth": ("depth", "lev", "deptht", "depthu", "DEPTH"),
    "time": ("time", "time_counter", "TIME"),
}


@dataclasses.dataclass(frozen=True)
class Moment:
    """Place and time that a mission starts at.

    Attributes:
        plane: plane around the start, or None where it is nowhere on Earth.
        start: time of the start, or None where it has no date.
        reach: distance from the start [m] that the mission may come to.
    """

    plane: Plane | None
    start: datetime.datetime | None
    reach: float = 30e3


def started(data: Mapping[str, Any]) -> datetime.datetime | None:
    """The date of the start in UTC, `clock.start`; None where a mission has none.

    Args:
        data: tables of the mission.

    Raises:
        ConfigError: it is no date.
    """
    clock = data.get("clock")
    value = clock.get("start") if isinstance(clock, dict) else None
    if value is None:
        return None
    if not isinstance(value, datetime.datetime):
        raise ConfigError(
            f"clock.start must be a date and time such as 2024-05-01T06:00:00Z, "
            f"without quotes; received {value!r}."
        )
    if value.tzinfo is None:
        return value.replace(tzinfo=datetime.UTC)
    return value.astimezone(datetime.UTC)


NOWHERE = (
    "{} is read at a place: give initial_state.latitude_deg and longitude_deg, where "
    "the glider starts."
)


def opened(path: Path) -> Any:
    """A NetCDF file, to be closed.

    Args:
        path: path of the file.

    Raises:
        ConfigError: xarray is not there, or the file cannot be read.
    """
    try:
        import xarray
    except ImportError as error:
        raise ConfigError(
            f"{path}: NetCDF files of the sea need the package xarray: "
            "pip install 'jaxglider[data]'."
        ) from error
    try:
        return xarray.open_dataset(path)
    except FileNotFoundError as error:
        raise ConfigError(f"{path} cannot be read: no such file.") from error
    except (OSError, ValueError, RuntimeError) as error:
        raise ConfigError(f"{path} cannot be read as NetCDF: {error}.") from error


def found(data: Any, key: str) -> str | None:
    """Name of a coordinate, or None where there is none.

    Args:
        data: opened file.
        key: latitude, longitude, depth or time.
    """
    return next((name for name in _NAMES[key] if name in data.variables), None)


def name_of(path: Path, data: Any, key: str) -> str:
    """Name of a coordinate.

    Args:
        path: path of the file, for the message.
        data: opened file.
        key: latitude, longitude, depth or time.

    Raises:
        ConfigError: there is none.
    """
    name = found(data, key)
    if name is None:
        raise ConfigError(
            f"{path}: no variable of {key} ({', '.join(_NAMES[key])}); it has "
            f"{', '.join(map(str, data.variables))}."
        )
    return name


def variable(path: Path, data: Any, names: Sequence[str]) -> Any:
    """The variable that has one of some names, as its own or its standard one.

    Args:
        path: path of the file, for the message.
        data: opened file.
        names: names, the best first.

    Raises:
        ConfigError: there is none.
    """
    for name in names:
        if name in data.data_vars:
            return data[name]
    for name, one in data.data_vars.items():
        if one.attrs.get("standard_name") in names:
            return data[name]
    raise ConfigError(
        f"{path}: none of the variables {', '.join(names)}; it has "
        f"{', '.join(map(str, data.data_vars))}."
    )


def reaches(path: Path, data: Any, plane: Plane, names: Sequence[str]) -> None:
    """Refuse a file that does not hold the start.

    Args:
        path: path of the file, for the message.
        data: opened file.
        plane: plane around the start.
        names: names of latitude and longitude.

    Raises:
        ConfigError: it does not.
    """
    here = (plane.latitude, plane.longitude)
    for name, at in zip(names, here, strict=True):
        low, high = float(data[name].min()), float(data[name].max())
        if not low <= at <= high:
            raise ConfigError(
                f"{path}: {name} goes from {low:g} to {high:g}; the start, "
                f"initial_state, is at {at:g}."
            )


def at_start(path: Path, data: Any, moment: Moment) -> Any:
    """The file at the place of the start, and at its time where it has a date.

    Args:
        path: path of the file, for the message.
        data: opened file.
        moment: place and time of the start.

    Raises:
        ConfigError: it does not reach the start, or the mission is nowhere on Earth.
    """
    if found(data, "latitude") and found(data, "longitude"):
        if moment.plane is None:
            raise ConfigError(NOWHERE.format(path))
        names = [name_of(path, data, key) for key in ("latitude", "longitude")]
        if all(data[name].ndim == 1 and data[name].size > 1 for name in names):
            turned = _in_its_longitudes(data, moment.plane, names[1])
            reaches(path, data, turned, names)
            places = dict(zip(names, (turned.latitude, turned.longitude), strict=True))
            data = data.sortby(names).interp(places)
    time = found(data, "time")
    if time is not None and data[time].ndim == 1 and moment.start is not None:
        stamp = np.datetime64(moment.start.replace(tzinfo=None), "ns")
        data = data.sel({time: stamp}, method="nearest")
    return data.squeeze()


def _in_its_longitudes(data: Any, plane: Plane, name: str) -> Plane:
    """The start with its longitude as the file counts: to 360, or to 180."""
    if float(data[name].max()) > 180.0 and plane.longitude < 0.0:
        return dataclasses.replace(plane, longitude=plane.longitude + 360.0)
    return plane
