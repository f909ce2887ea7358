"""NetCDF files of the sea, looked at from the start of a mission; read by xarray."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.core.toml import ConfigError, reason
from jaxglider.files.sea.moment import Moment
from jaxglider.files.sea.places import Plane

_NAMES = {
    "latitude": ("latitude", "lat", "nav_lat", "LATITUDE"),
    "longitude": ("longitude", "lon", "nav_lon", "LONGITUDE"),
    "depth": ("depth", "lev", "deptht", "depthu", "DEPTH"),
    "time": ("time", "time_counter", "TIME"),
}


def opened(path: Path) -> Any:
    """A NetCDF file, to be closed; its times stay numbers until `seconds` reads them.

    Climatologies count in months, which are no dates.

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
        return xarray.open_dataset(path, engine="netcdf4", decode_times=False)
    except FileNotFoundError as error:
        raise ConfigError(f"{path} cannot be read: {reason(error)}.") from error
    except (OSError, ValueError, RuntimeError) as error:
        raise ConfigError(
            f"{path} cannot be read: {reason(error)}. It must be NetCDF."
        ) from error


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
        f"{', '.join(map(str, data.data_vars)) or 'none'}. Take another file, or "
        "rename one, by `ncrename -v` for one."
    )


def grid_names(path: Path, data: Any) -> list[str]:
    """Names of latitude and longitude.

    Args:
        path: path of the file, for the message.
        data: opened file.

    Raises:
        ConfigError: there are none, or they are no axes of a grid.
    """
    names = [name_of(path, data, key) for key in ("latitude", "longitude")]
    for name in names:
        if data[name].dims not in ((), (name,)):
            raise ConfigError(
                f"{path}: {name} must be an axis of the grid; it goes over "
                f"{', '.join(map(str, data[name].dims))}. Put the file on a grid of "
                "latitudes and longitudes first, by `cdo remapbil` for one."
            )
    return names


def reached(path: Path, data: Any, moment: Moment, names: Sequence[str]) -> Plane:
    """The plane around the start, its longitude as the file counts: to 360, or to 180.

    Args:
        path: path of the file, for the message.
        data: opened file.
        moment: place and time of the start.
        names: names of latitude and longitude.

    Raises:
        ConfigError: the mission is nowhere on Earth, or the start is not in the file.
    """
    plane = moment.plane
    if plane is None:
        raise ConfigError(
            f"{path} is read at a place: give initial_state.latitude_deg and "
            "longitude_deg, where the glider starts."
        )
    if float(data[names[1]].max()) > 180.0 and plane.longitude < 0.0:
        plane = dataclasses.replace(plane, longitude=plane.longitude + 360.0)
    here = (plane.latitude, plane.longitude)
    for name, at in zip(names, here, strict=True):
        low, high = float(data[name].min()), float(data[name].max())
        if not low <= at <= high:
            raise ConfigError(
                f"{path}: {name} goes from {low:g} to {high:g}; the start, "
                f"initial_state, is at {at:g}. Take a file that holds it."
            )
    return plane


def at_place(path: Path, data: Any, moment: Moment) -> Any:
    """The file at the place of the start; as it is where it has one place only.

    Args:
        path: path of the file, for the message.
        data: opened file.
        moment: place and time of the start.

    Raises:
        ConfigError: it does not reach the start, or the mission is nowhere on Earth.
    """
    if not (found(data, "latitude") and found(data, "longitude")):
        return data
    names = grid_names(path, data)
    if any(data[name].size == 1 for name in names):
        return data
    plane = reached(path, data, moment, names)
    places = dict(zip(names, (plane.latitude, plane.longitude), strict=True))
    return data.sortby(names).interp(places)


def at_time(path: Path, data: Any, moment: Moment) -> Any:
    """The file at that of its times which is nearest to the start.

    Args:
        path: path of the file, for the message.
        data: opened file.
        moment: place and time of the start.

    Raises:
        ConfigError: it has several times, and does not reach the start.
    """
    times = seconds(path, data, moment)
    if len(times) == 1:
        return data
    (axis,) = data[name_of(path, data, "time")].dims
    return data.isel({axis: int(np.argmin(np.abs(times)))})


def seconds(path: Path, data: Any, moment: Moment) -> np.ndarray:
    """Times of the file from the start of the mission on [s]; 0 where it has but one.

    Args:
        path: path of the file, for the message.
        data: opened file.
        moment: place and time of the start.

    Raises:
        ConfigError: it has several times, and they are no dates around the start.
    """
    name = found(data, "time")
    if name is None or data[name].size == 1:
        return np.array([0.0])
    if moment.start is None:
        raise ConfigError(
            f"{path} has {data[name].size} times: give the date of the start, such as "
            "clock.start = 2024-05-01T06:00:00Z."
        )
    import xarray

    try:
        stamps = np.asarray(xarray.decode_cf(data[[name]])[name])
    except ValueError:
        stamps = np.asarray(data[name])
    if not np.issubdtype(stamps.dtype, np.datetime64):
        raise ConfigError(
            f"{path}: {name} must be in seconds, hours or days since a date of the "
            f"usual calendar; received {data[name].attrs.get('units', 'no unit')!r}. "
            "Cut out the one time that is meant, by `ncks -d` for one."
        )
    zero = np.datetime64(moment.start.replace(tzinfo=None), "ns")
    times = np.asarray((stamps - zero) / np.timedelta64(1, "s"), float)
    if not times[0] <= 0.0 <= times[-1]:
        first, last = np.datetime_as_string(stamps[[0, -1]], "m")
        raise ConfigError(
            f"{path} goes from {first} to {last}: clock.start must lie in between; "
            f"received {moment.start.isoformat()}."
        )
    return times


def depths(path: Path, data: Any) -> np.ndarray:
    """Depths of the file [m].

    Args:
        path: path of the file, for the message.
        data: opened file.

    Raises:
        ConfigError: there are none, or they do not rise downwards.
    """
    name = name_of(path, data, "depth")
    values = np.atleast_1d(np.asarray(data[name], float))
    if values[0] < 0.0 or not np.all(np.diff(values) > 0.0):
        raise ConfigError(
            f"{path}: {name} must rise from the surface down, positive; received "
            f"{values[0]:g} to {values[-1]:g}."
        )
    return values


def over(path: Path, values: Any, keys: Sequence[str | None]) -> np.ndarray:
    """Numbers of a variable over some coordinates, in that order, and over no other.

    Args:
        path: path of the file, for the message.
        values: variable.
        keys: names of the coordinates; None for one that the file lacks.

    Raises:
        ConfigError: it goes over something else too.
    """
    wanted = [values[key].dims for key in keys if key in values.coords]
    axes = [axis for dims in wanted for axis in dims]
    others = [axis for axis in values.dims if axis not in axes]
    large = [str(axis) for axis in others if values.sizes[axis] > 1]
    if large:
        raise ConfigError(
            f"{path}: {values.name} goes over {', '.join(large)} too, and no variable "
            "says where along that: cut out one place, by `ncks -d` for one."
        )
    flat = values.isel(dict.fromkeys(others, 0)).transpose(*axes)
    return np.asarray(flat, float).reshape(
        [values[key].size if key in values.coords else 1 for key in keys]
    )
