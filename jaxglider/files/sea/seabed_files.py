"""The bottom from NetCDF files: `elevation` as GEBCO has it, `deptho` of Copernicus."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxglider.files.sea.moment import Moment
from jaxglider.files.sea.netcdf import grid_names, opened, over, reached, variable

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
    with opened(path) as data:
        import xarray

        rise = variable(path, data, ("elevation", "z", "deptho", "depth", "Band1"))
        names = grid_names(path, data)
        start = reached(path, data, moment, names)
        side = np.linspace(-moment.reach, moment.reach, PLACES)
        north, east = np.meshgrid(side, side, indexing="ij")
        latitude, longitude = start.degrees(north.ravel(), east.ravel())
        # Nearest to the start's, beyond the date line too.
        longitude = start.longitude + (longitude - start.longitude + 180) % 360 - 180
        there = {
            name: xarray.DataArray(
                np.clip(places, float(data[name].min()), float(data[name].max())),
                dims="place",
            )
            for name, places in zip(names, (latitude, longitude), strict=True)
        }
        # xarray reads what is around these places: GEBCO as a whole is 7 GB.
        one = rise.sortby(names).interp(there)
        depth = over(path, one, [names[0]]).reshape(north.shape)
    downwards = rise.name in ("deptho", "depth")
    depth = np.nan_to_num(depth if downwards else -depth)
    return {
        "north_m": side.tolist(),
        "east_m": side.tolist(),
        "depth_m": depth.tolist(),
    }
