"""The rows of a campaign as NetCDF: one row a member, with units and names."""

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from jaxglider.files.results import write_head
from jaxglider.files.writing import replacing
from tuning.campaign.run.rows import FLAGS, unit
from tuning.campaign.run.store import Manifest


def write_members(
    path: Path, manifest: Manifest, rows: np.ndarray, about: dict[str, Any]
) -> None:
    """Write what was drawn for each member and what came of it, as CF has it.

    Dimensions `member` and `gains`. A variable for each uncertain quantity (member),
    and for each metric and flag (member, gains); NaN is what a run came to that did not
    stay finite.

    Args:
        path: path of the file.
        manifest: manifest of the campaign.
        rows: rows, which may be mapped from a file.
        about: provenance, kept as a JSON attribute.

    Raises:
        OSError: the file cannot be written.
    """
    with (
        replacing(path) as temporary,
        netCDF4.Dataset(temporary, "w", format="NETCDF4") as file,
    ):
        title = "Monte Carlo members of closed-loop runs of an underwater glider"
        write_head(file, title, about)
        file.createDimension("member", len(rows))
        file.createDimension("gains", len(manifest.labels))
        label = file.createVariable("gains_name", str, ("gains",))
        label.long_name = "set of gains"
        label[:] = np.asarray(list(manifest.labels), dtype=object)
        number = file.createVariable("member", "i4", ("member",), zlib=True)
        number.long_name = "number of the member, as for jaxglider rerun"
        number[:] = rows["member"]
        for column, (name, place, units) in enumerate(manifest.quantities):
            variable = file.createVariable(
                name, "f8", ("member",), zlib=True, complevel=1
            )
            variable.units, variable.long_name = units, f"drawn value of {place}"
            variable[:] = rows["values"][:, column]
        for column, name in enumerate(manifest.columns):
            _write_column(file, name, rows["metrics"][:, :, column])


def _write_column(file: Any, name: str, values: np.ndarray) -> None:
    kind = "i1" if name in FLAGS else "f8"
    variable = file.createVariable(
        # What is drawn may have the name of an outcome: that of the run says so.
        f"run_{name.replace('.', '_')}",
        kind,
        ("member", "gains"),
        zlib=True,
        complevel=1,
    )
    variable.units, variable.long_name = unit(name), name.replace("_", " ")
    variable.coordinates = "gains_name"
    variable[:] = values.astype(np.int8) if kind == "i1" else values
