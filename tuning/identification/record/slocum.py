"""Slocum records: dbd/sbd/mbd and ebd/tbd/nbd files, and tables of gliderflight.

The binary files are read by the optional package dbdreader (GPL-3, which is why it is
in an extra of its own, `dbd`, and nothing else needs it). It needs the cache files
(.cac) of the vehicle; those that lie beside the data are used.

The table is that of Merckelbach's package gliderflight (MIT): a NumPy array of six
rows, time [s], pressure [bar], pitch [rad], ballast [cm³], density [kg/m³], speed
[m/s].
"""

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tuning.identification.record.columns import Column
from tuning.identification.record.flight_record import Finding, FlightRecord, Series

BINARY = tuple(f".{letter}bd" for letter in "dsmetn")
"""Endings of the binary files: flight computer first, then science."""

COLUMNS = (
    Column("pressure", ("sci_water_pressure", "m_pressure"), "bar"),
    Column("depth", ("m_depth",), "m"),
    Column("pitch", ("m_pitch",), "rad"),
    Column("roll", ("m_roll",), "rad"),
    Column("heading", ("m_heading",), "rad"),
    Column("wanted_heading", ("c_heading",), "rad"),
    Column("ballast", ("m_ballast_pumped", "m_de_oil_vol"), "cc"),
    Column("mass_position", ("m_battpos",), "in"),
    Column("mass_angle", ("m_battroll",), "rad"),
    Column("fin", ("m_fin",), "rad"),
    Column("temperature", ("sci_water_temp",), "degC"),
    Column("conductivity", ("sci_water_cond",), "S/m"),
    Column("latitude", ("m_gps_lat",), "deg"),
    Column("longitude", ("m_gps_lon",), "deg"),
)
"""Sensors of the vehicle that become channels, in the vehicle's own units."""


def read_binary(paths: Sequence[Path]) -> FlightRecord:
    """A flight from the binary files of a Slocum.

    Args:
        paths: files of one flight; caches (.cac) beside them are found.

    Raises:
        ValueError: dbdreader is not there, or the files cannot be read.
    """
    try:
        import dbdreader
    except ImportError as error:
        raise ValueError(
            f"{paths[0]}: Slocum's binary files need the package dbdreader (GPL-3): "
            "pip install 'jaxglider[dbd]'."
        ) from error
    with tempfile.TemporaryDirectory() as cache:
        for folder in {path.parent for path in paths}:
            for file in [*folder.glob("*.cac"), *folder.glob("*.CAC")]:
                shutil.copy(file, Path(cache) / file.name.lower())
        try:
            reader = dbdreader.MultiDBD(
                filenames=[str(path) for path in paths], cacheDir=cache
            )
            channels = _sensors(reader)
            reader.close()
        except (dbdreader.DbdError, OSError, RuntimeError) as error:
            raise ValueError(
                f"{paths[0]} and {len(paths) - 1} more cannot be read: {error}. Are "
                "the cache files (.cac) beside them, and are they complete?"
            ) from error
    findings = [
        Finding(
            "pitch",
            "as the sensor gave it: its tilt is unknown until a speed is fitted.",
        )
    ]
    if "mass_angle" in channels and np.ptp(channels["mass_angle"].values) < 1e-6:
        del channels["mass_angle"]
    return FlightRecord(paths[0].stem, "Slocum binary", channels, tuple(findings))


def _sensors(reader: object) -> dict[str, Series]:
    """Each sensor that some file has, with its own times."""
    channels: dict[str, Series] = {}
    names = {n for group in reader.parameterNames.values() for n in group}  # type: ignore[attr-defined]
    for column in COLUMNS:
        for name in column.names:
            if name not in names or column.channel in channels:
                continue
            time, values = reader.get(name)  # type: ignore[attr-defined]
            if column.channel in ("pressure", "temperature", "conductivity"):
                # Rows of the science computer before its first sample hold zeros.
                good = values != 0.0
                time, values = time[good], values[good]
            if len(time) > 1 and np.isfinite(values).sum() > 1:
                channels[column.channel] = column.series(time, values)
    return channels


_ROWS = (
    Column("pressure", ("1",), "bar"),
    Column("pitch", ("2",), "rad"),
    Column("ballast", ("3",), "cc"),
    Column("density", ("4",), "kg/m^3"),
    Column("speed", ("5",), "m/s"),
)


def read_table(path: Path) -> FlightRecord:
    """A flight from the six rows of gliderflight's table.

    Args:
        path: .npy file.

    Raises:
        ValueError: it holds something else.
    """
    try:
        table = np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise ValueError(f"{path}: no NumPy array of numbers: {error}.") from error
    if table.ndim != 2 or table.shape[0] != 6:
        raise ValueError(
            f"{path}: must hold six rows (time, pressure, pitch, ballast, density, "
            f"speed), as gliderflight's does; received an array of {table.shape}."
        )
    channels = {
        column.channel: column.series(table[0], table[int(column.names[0])])
        for column in _ROWS
        if np.isfinite(table[int(column.names[0])]).any()
    }
    return FlightRecord(path.stem, "gliderflight table", channels)
