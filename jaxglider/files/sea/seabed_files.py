"""The bottom from NetCDF files: `elevation` as GEBCO has it, `deptho` of Copernicus."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.core.toml import ConfigError
from jaxglider.files.sea.netcdf import (
    NOWHERE,
    Moment,
    name_of,
    opened,
    reaches,
    variable,
)

PLACES = 121
"""Number of places along a side of the piece that a mission takes along."""


def read_seabed_grid(path: Path, moment: Moment) -> dict[str, Any]:
    """Depth of the bottom on a grid of metres around the start.

    Args:
        path: NetCDF file.
        moment: place and time of the start.

    Raises:
        ConfigError: it cannot be read, or does not reach the start.
    """
    if moment.plane is None:
        raise ConfigError(NOWHERE.format(path))
    with opened(path) as data:
        rise = variable(path, data, ("elevation", "z", "deptho", "depth", "Band1"))
        names = [name_of(path, data, key) for key in ("latitude", "longitude")]
        rise = rise.squeeze().transpose(*names).sortby(names)
        reaches(path, rise, moment.plane, names)
        latitudes, longitudes = (np.asarray(rise[name], float) for name in names)
        side = np.linspace(-moment.reach, moment.reach, PLACES)
        north, east = np.meshgrid(side, side, indexing="ij")
        there = moment.plane.degrees(north.ravel(), east.ravel())
        inside = [
            np.clip(values, places[0], places[-1])
            for values, places in zip(there, (latitudes, longitudes), strict=True)
        ]
        from scipy.interpolate import RegularGridInterpolator

        look = RegularGridInterpolator((latitudes, longitudes), np.asarray(rise, float))
        depth = look(np.stack(inside, axis=1)).reshape(north.shape)
    downwards = rise.name in ("deptho", "depth")
    depth = np.nan_to_num(depth if downwards else -depth)
    return {
        "north_m": side.tolist(),
        "east_m": side.tolist(),
        "depth_m": depth.tolist(),
    }
