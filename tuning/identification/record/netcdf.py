"""NetCDF records: OG-1.0, as pyglider and seagliderOG1 write it, and Seaglider's dives.

Source of the names: the OG-1.0 user manual, and the per-dive files (p*.nc) of the
Seaglider basestation. OG-1.0 has no agreed name for the volume of ballast or for the
places of the masses; those of seagliderOG1 (VBD_CC, PITCH_CTL, ROLL_CTL) are read where
they are there, and what is missing is said.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tuning.identification.record.columns import Column, wrapped
from tuning.identification.record.flight_record import (
    Finding,
    FlightRecord,
    Series,
    joined,
)

OG1 = (
    Column("pressure", ("PRES", "pressure"), "dbar"),
    Column("depth", ("DEPTH", "depth"), "m"),
    Column("pitch", ("PITCH", "pitch"), "deg"),
    Column("roll", ("ROLL", "roll"), "deg"),
    Column("heading", ("HEADING", "heading"), "deg", wrapped),
    Column("ballast", ("VBD_CC",), "cc"),
    Column("mass_position", ("PITCH_CTL",), "cm"),
    Column("mass_angle", ("ROLL_CTL",), "deg"),
    Column("density", ("DENSITY",), "kg/m^3"),
    Column("temperature", ("TEMP", "temperature"), "degC"),
    Column("salinity", ("PSAL", "salinity"), "1"),
    Column("conductivity", ("CNDC", "conductivity"), "S/m"),
    Column("latitude", ("LATITUDE", "latitude"), "deg"),
    Column("longitude", ("LONGITUDE", "longitude"), "deg"),
)
"""Variables of OG-1.0, and of pyglider's timeseries in small letters."""
SEAGLIDER = (
    Column("pressure", ("ctd_pressure", "pressure"), "dbar"),
    Column("depth", ("depth", "ctd_depth"), "m"),
    Column("pitch", ("eng_pitchAng",), "deg"),
    Column("roll", ("eng_rollAng",), "deg"),
    Column("heading", ("eng_head",), "deg", wrapped),
    Column("ballast", ("eng_vbdCC",), "cc"),
    Column("mass_position", ("eng_pitchCtl",), "cm"),
    Column("mass_angle", ("eng_rollCtl",), "deg"),
    Column("temperature", ("temperature",), "degC"),
    Column("salinity", ("salinity",), "1"),
    Column("latitude", ("latitude",), "deg"),
    Column("longitude", ("longitude",), "deg"),
)
"""Variables of a Seaglider's dive."""


def read_netcdf(paths: Sequence[Path]) -> FlightRecord:
    """A flight from NetCDF files, one or one for each dive.

    Args:
        paths: files of one flight and one format.

    Raises:
        ValueError: xarray is not there, a file cannot be read, or is of neither format.
    """
    try:
        import xarray
    except ImportError as error:
        raise ValueError(
            f"{paths[0]}: NetCDF records need the package xarray: "
            "pip install 'jaxglider[data]'."
        ) from error
    parts: dict[str, list[Series]] = {}
    kinds, findings = set(), []
    for path in paths:
        try:
            with xarray.open_dataset(path, decode_times=False) as data:
                kind, columns = _kind(data, path)
                kinds.add(kind)
                for column in columns:
                    series = _series(data, column)
                    if series is not None:
                        parts.setdefault(column.channel, []).append(series)
        except (OSError, RuntimeError) as error:
            raise ValueError(f"{path} cannot be read: {error}.") from error
        except ValueError as error:
            if str(path) in str(error):
                raise
            raise ValueError(f"{path} cannot be read as NetCDF.") from error
    if len(kinds) > 1:
        raise ValueError(f"files must be of one format; received {sorted(kinds)}.")
    kind = kinds.pop()
    channels = {name: joined(series) for name, series in parts.items()}
    if kind == "OG-1.0" and "ballast" not in channels:
        findings.append(
            Finding(
                "ballast",
                "OG-1.0 has no agreed variable for it: no fit can do without. Read the "
                "vehicle's own files, or add VBD_CC in cm^3.",
                warning=True,
            )
        )
    return FlightRecord(paths[0].stem, kind, channels, tuple(findings))


def _kind(data: Any, path: Path) -> tuple[str, tuple[Column, ...]]:
    if "eng_pitchAng" in data.variables:
        return "Seaglider", SEAGLIDER
    if "TIME" in data.variables or "time" in data.variables:
        return "OG-1.0", OG1
    raise ValueError(
        f"{path}: neither OG-1.0 (TIME, PRES, PITCH, ...) nor a Seaglider's dive "
        f"(eng_pitchAng, ...); it has {', '.join(map(str, list(data.variables)[:6]))}."
    )


def _series(data: Any, column: Column) -> Series | None:
    """A variable with the times of its dimension; none where it is not there."""
    for name in column.names:
        if name not in data.variables:
            continue
        variable = data[name]
        if variable.ndim != 1:
            continue
        clock = _clock(data, variable)
        if clock is None:
            continue
        values = np.asarray(variable.values, dtype=float)
        return column.series(clock, values, str(variable.attrs.get("units", "")))
    return None


def _clock(data: Any, variable: Any) -> np.ndarray | None:
    """Times [s] of the rows of a variable, whatever unit the file counts in."""
    for name in ("TIME", "time", "ctd_time"):
        if name in data.variables and data[name].dims == variable.dims:
            counted = np.asarray(data[name].values, dtype=float)
            return _clock_unit(str(data[name].attrs.get("units", ""))) * counted
    return None


def _clock_unit(text: str) -> float:
    words = {"days": 86400.0, "hours": 3600.0, "minutes": 60.0, "milliseconds": 1e-3}
    return words.get(text.split(" ")[0], 1.0)
