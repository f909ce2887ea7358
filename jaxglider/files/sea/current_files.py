"""Currents from the NetCDF files of ocean models, as Copernicus Marine has them.

`uo` and `vo` over time and depth, at the place of the start: tens of kilometres on, the
sea may move otherwise.
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.core.toml import ConfigError
from jaxglider.files.sea.netcdf import (
    Moment,
    at_start,
    found,
    name_of,
    opened,
    variable,
)

DAYS = 30.0
"""Length of the currents that a mission takes along [days]."""


def read_currents(path: Path, moment: Moment) -> dict[str, Any]:
    """Velocities at the place of the start over time [s] and depth [m].

    Args:
        path: NetCDF file.
        moment: place and time of the start.

    Raises:
        ConfigError: it cannot be read, does not reach the start, or lacks a variable.
    """
    with opened(path) as data:
        one = at_start(path, data, dataclasses.replace(moment, start=None))
        north = variable(path, one, ("vo", "v", "northward_sea_water_velocity"))
        east = variable(path, one, ("uo", "u", "eastward_sea_water_velocity"))
        times = _times(path, one, moment)
        depth = np.atleast_1d(
            np.asarray(one[name_of(path, one, "depth")], float)
            if found(one, "depth")
            else 0.0
        )
        shape = (len(times), len(depth))
        tables = [np.asarray(v, float).reshape(shape) for v in (north, east)]
    near = (times > -86400.0) & (times < DAYS * 86400.0)
    times, tables = times[near], [table[near] for table in tables]
    wet = np.isfinite(tables[0]).any(axis=0)
    if not wet.any():
        raise ConfigError(
            f"{path}: no currents at the start, initial_state: is it on land there?"
        )
    depth = depth[wet]
    tables = [np.nan_to_num(table[:, wet]) for table in tables]
    if len(times) == 1:
        times = np.array([times[0], times[0] + 1.0])
        tables = [np.repeat(table, 2, axis=0) for table in tables]
    if len(depth) == 1:
        depth = np.array([depth[0], depth[0] + 1.0])
        tables = [np.repeat(table, 2, axis=1) for table in tables]
    return {
        "time_s": times.tolist(),
        "depth_m": depth.tolist(),
        "north_m_s": tables[0].tolist(),
        "east_m_s": tables[1].tolist(),
    }


def _times(path: Path, one: Any, moment: Moment) -> np.ndarray:
    """Times of the file from the start of the mission on [s]."""
    if not found(one, "time"):
        return np.array([0.0])
    stamps = np.atleast_1d(np.asarray(one[name_of(path, one, "time")]))
    if len(stamps) == 1:
        return np.array([0.0])
    if moment.start is None:
        raise ConfigError(
            f"{path} has {len(stamps)} times: give the date of the start, such as "
            "clock.start = 2024-05-01T06:00:00Z."
        )
    zero = np.datetime64(moment.start.replace(tzinfo=None), "ns")
    seconds = (stamps - zero) / np.timedelta64(1, "s")
    if not seconds[0] <= 0.0 <= seconds[-1]:
        raise ConfigError(
            f"{path} goes from {stamps[0]} to {stamps[-1]}: clock.start must lie in "
            f"between; received {moment.start.isoformat()}."
        )
    return np.asarray(seconds, float)
