"""Currents from the NetCDF files of ocean models, as Copernicus Marine has them.

`uo` and `vo` over time and depth, at the place of the start: tens of kilometres on, the
sea may move otherwise.
"""

from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.core.toml import ConfigError
from jaxglider.files.sea.moment import Moment
from jaxglider.files.sea.netcdf import (
    at_place,
    depths,
    found,
    opened,
    over,
    seconds,
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
        one = at_place(path, data, moment)
        north = variable(path, one, ("vo", "v", "northward_sea_water_velocity"))
        east = variable(path, one, ("uo", "u", "eastward_sea_water_velocity"))
        times = seconds(path, one, moment)
        depth = depths(path, one) if found(one, "depth") else np.zeros(1)
        axes = [found(one, key) for key in ("time", "depth")]
        tables = [over(path, values, axes) for values in (north, east)]
    # The times around the start and around the last day, for what is in between.
    first = max(int(np.searchsorted(times, 0.0, side="right")) - 1, 0)
    last = int(np.searchsorted(times, DAYS * 86400.0)) + 1
    times, tables = times[first:last], [table[first:last] for table in tables]
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
