"""A simulated flight as OG-1.0 NetCDF, as the glider itself would have recorded it.

Source: OceanGliders format user manual, version 1.0, and the CF conventions. OG-1.0 has
no agreed names for the places of ballast and masses; those of seagliderOG1 are used:
VBD_CC, PITCH_CTL, ROLL_CTL.
"""

import datetime
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from jaxglider.files.records.og1_variables import (
    EPOCH,
    VARIABLES,
    Variable,
    og1_columns,
)
from jaxglider.files.writing import replacing
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.scenario import Scenario

_VOCABULARY = "http://vocab.nerc.ac.uk/collection/OG1/current/{}/"


def identifier(name: str, start: datetime.datetime | None) -> str:
    """The name that OG-1.0 gives a data set: serial number, start, and data mode.

    Args:
        name: name of the mission.
        start: date of its start; `EPOCH` if None.
    """
    serial = "".join(c if c.isalnum() else "-" for c in name).strip("-").lower()
    return f"{serial or 'glider'}_{_stamp(start or EPOCH)}_delayed"


def _stamp(moment: datetime.datetime) -> str:
    return moment.strftime("%Y%m%dT%H%M%S")


def write_og1(
    path: str | Path,
    run: Trajectory,
    scenario: Scenario,
    name: str,
    start: datetime.datetime | None,
    about: Mapping[str, Any],
) -> None:
    """Write a flight as OG-1.0.

    Args:
        path: path of the file.
        run: trajectory on the host.
        scenario: scenario that it was flown in.
        name: name of the mission.
        start: date of the start; `EPOCH` if None.
        about: provenance, kept as a JSON attribute.

    Raises:
        ConfigError: the mission is nowhere on Earth.
        OSError: the file cannot be written.
    """
    columns = og1_columns(run, scenario, start)
    data_set = identifier(name, start)
    with (
        replacing(path) as temporary,
        netCDF4.Dataset(temporary, "w", format="NETCDF4") as file,
    ):
        _head(file, data_set, name, start, columns, about)
        file.createDimension("N_MEASUREMENTS", len(columns["TIME"]))
        for key, values in columns.items():
            _variable(file, key, VARIABLES[key], values)
        _platform(file, data_set.rpartition("_")[0], name, columns)


def _variable(file: Any, key: str, about: Variable, values: np.ndarray) -> None:
    kind = "f8" if key.startswith(("TIME", "LAT", "LON", "DEPTH")) else "f4"
    variable = file.createVariable(
        key, kind, ("N_MEASUREMENTS",), zlib=True, complevel=1, fill_value=np.nan
    )
    variable.long_name, variable.units = about.text, about.unit
    if about.standard_name:
        variable.standard_name = about.standard_name
    if about.term:
        variable.vocabulary = _VOCABULARY.format(about.term)
    if about.low is not None:
        numbers = [variable.dtype.type(x) for x in (about.low, about.high)]
        variable.valid_min, variable.valid_max = numbers
    if key.startswith("TIME"):
        variable.calendar = "gregorian"
    elif not key.startswith(("LAT", "LON", "DEPTH")):
        variable.coordinates = "TIME LATITUDE LONGITUDE DEPTH"
    if key == "DEPTH":
        variable.positive = "down"
    if key in ("TIME", "LATITUDE", "LONGITUDE", "DEPTH"):
        variable.axis = {"TIME": "T", "LATITUDE": "Y", "LONGITUDE": "X"}.get(key, "Z")
    variable[:] = values


def _head(
    file: Any,
    data_set: str,
    name: str,
    start: datetime.datetime | None,
    columns: Mapping[str, np.ndarray],
    about: Mapping[str, Any],
) -> None:
    """Attributes of the file as a whole, those that OG-1.0 demands among them."""
    first, last = (
        _stamp(datetime.datetime.fromtimestamp(t, datetime.UTC))
        for t in columns["TIME"][[0, -1]]
    )
    undated = "" if start else " It has no date: that of the start stands for one."
    attributes = {
        "Conventions": "CF-1.10, ACDD-1.3, OG-1.0",
        "featureType": "trajectory",
        "title": f"Simulated flight of an underwater glider: {name}",
        "platform": "sub-surface gliders",
        "platform_vocabulary": "http://vocab.nerc.ac.uk/collection/L06/current/27/",
        "id": data_set,
        "comment": f"Simulated by jaxglider; nothing was measured at sea.{undated}",
        "contributor_name": "jaxglider",
        "contributor_email": "none",
        "contributor_role": "simulation",
        "contributor_role_vocabulary": "http://vocab.nerc.ac.uk/search_nvs/W08/",
        "contributing_institutions": "none",
        "contributing_institutions_role": "Operator",
        "contributing_institutions_role_vocabulary": (
            "http://vocab.nerc.ac.uk/collection/W08/current/"
        ),
        "rtqc_method": "No QC applied",
        "start_date": first,
        "time_coverage_start": first,
        "time_coverage_end": last,
        "date_created": _stamp(datetime.datetime.now(datetime.UTC)),
        "source": "jaxglider",
        "history": f"{about.get('created', '')} jaxglider",
        "provenance": json.dumps(dict(about)),
    }
    for key, value in attributes.items():
        file.setncattr(key, value)


def _platform(
    file: Any, trajectory: str, name: str, columns: Mapping[str, np.ndarray]
) -> None:
    """The variables without a dimension: who flew, and where it was put to sea."""
    texts = {
        "TRAJECTORY": (trajectory, "trajectory name"),
        "PLATFORM_MODEL": ("simulated glider", "model of the glider"),
        "PLATFORM_SERIAL_NUMBER": (
            trajectory.partition("_")[0],
            "glider serial number",
        ),
        "PLATFORM_NAME": (name, "local name of the glider"),
        "WMO_IDENTIFIER": ("none", "wmo id"),
    }
    for key, (value, text) in texts.items():
        variable = file.createVariable(key, str, ())
        variable.long_name = text
        if key == "TRAJECTORY":
            variable.cf_role = "trajectory_id"
        variable[...] = np.asarray(value, dtype=object)
    for key in ("TIME", "LATITUDE", "LONGITUDE"):
        variable = file.createVariable(f"DEPLOYMENT_{key}", "f8", ())
        about = VARIABLES[key]
        variable.long_name = f"{about.standard_name} of deployment"
        variable.standard_name, variable.units = about.standard_name, about.unit
        if key == "TIME":
            variable.calendar = "gregorian"
        variable[...] = columns[key][0]
