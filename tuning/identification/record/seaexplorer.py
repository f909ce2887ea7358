"""SeaExplorer records: gli and pld files, CSV with semicolons, plain or gzipped.

`gli` is what the vehicle recorded (attitude, actuators), `pld` its payload (CTD).
Angles are in degrees, ballast in ml, the linear mass in mm; positions in ddmm.mmm.
"""

import csv
import datetime
import gzip
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tuning.identification.record.columns import (
    Column,
    channels_of,
    from_nmea,
    wrapped,
)
from tuning.identification.record.flight_record import (
    Finding,
    FlightRecord,
    Series,
    joined,
)

GLIDER = (
    Column("depth", ("Depth",), "m"),
    Column("pitch", ("Pitch",), "deg"),
    Column("roll", ("Roll",), "deg"),
    Column("heading", ("Heading",), "deg", wrapped),
    Column("wanted_heading", ("DesiredH",), "deg", wrapped),
    Column("ballast", ("BallastPos",), "ml"),
    Column("mass_position", ("LinPos",), "mm"),
    Column("mass_angle", ("AngPos",), "deg"),
    Column("latitude", ("Lat",), "", from_nmea),
    Column("longitude", ("Lon",), "", from_nmea),
)
"""Columns of the vehicle's file."""
PAYLOAD = (
    Column("pressure", ("GPCTD_PRESSURE", "LEGATO_PRESSURE"), "dbar"),
    Column("temperature", ("GPCTD_TEMPERATURE", "LEGATO_TEMPERATURE"), "degC"),
    Column("conductivity", ("GPCTD_CONDUCTIVITY",), "S/m"),
    Column("salinity", ("LEGATO_SALINITY",), "1"),
)
"""Columns of the payload's file."""
NOTHING = 9999.0
"""Number that stands for none."""


def is_seaexplorer(path: Path) -> bool:
    """Whether a file name is that of a SeaExplorer: `.gli.` or `.pld1.` in it."""
    name = path.name.lower()
    return ".gli." in name or ".pld" in name


def read_seaexplorer(paths: Sequence[Path]) -> FlightRecord:
    """A flight from gli and pld files, any number of each.

    Args:
        paths: files of one flight.

    Raises:
        ValueError: a file has no such columns, or a time cannot be read.
    """
    parts: dict[str, list[Series]] = {}
    findings: list[Finding] = []
    for path in paths:
        ours = ".gli." in path.name.lower()
        table, time = _table(path, "Timestamp" if ours else "PLD_REALTIMECLOCK")
        if not len(time):
            findings.append(Finding(path.name, "has no rows; left out."))
            continue
        if not ours and "GPCTD_CONDUCTIVITY" in table:
            # A pump that does not run leaves values that are none.
            dry = table["GPCTD_CONDUCTIVITY"] < 1e-3
            table["GPCTD_CONDUCTIVITY"][dry] = np.nan
        for name, series in channels_of(
            GLIDER if ours else PAYLOAD, table, time
        ).items():
            parts.setdefault(name, []).append(series)
        if ours and np.nanmax(np.abs(table.get("Declination", np.zeros(1)))) > 0:
            declination = float(np.nanmedian(table["Declination"]))
            findings.append(
                Finding(
                    "heading",
                    f"magnetic: the column Declination says {declination:g} deg; not "
                    "added, a fit uses changes of heading only.",
                )
            )
    channels = {
        name: joined(sorted(series, key=lambda s: s.time[0] if len(s) else np.inf))
        for name, series in parts.items()
    }
    unique = tuple(dict.fromkeys(findings))
    return FlightRecord(
        paths[0].name.split(".gli")[0].split(".pld")[0], "SeaExplorer", channels, unique
    )


def _table(path: Path, clock: str) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Columns of numbers, and the times of the rows [s since 1970]."""
    opener = gzip.open if path.suffix == ".gz" else open
    try:
        with opener(path, "rt", encoding="utf-8", errors="replace", newline="") as file:
            rows = list(csv.reader(file, delimiter=";"))
    except (OSError, EOFError) as error:
        raise ValueError(f"{path} cannot be read: {error}.") from error
    if not rows or clock not in rows[0]:
        found = ", ".join(rows[0][:4]) if rows else "nothing"
        raise ValueError(
            f"{path}: its first line must name {clock}, as SeaExplorer writes it with "
            f"semicolons; received {found}."
        )
    head = rows[0]
    body = [row for row in rows[1:] if len(row) >= len(head) - 1]
    place = head.index(clock)
    time = np.array([_seconds(row[place]) for row in body], dtype=float)
    table = {}
    for number, name in enumerate(head):
        if name and number != place:
            values = np.array([_number(row[number]) for row in body])
            table[name] = values
    good = np.isfinite(time)
    return {name: values[good] for name, values in table.items()}, time[good]


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return float("nan")
    return float("nan") if value == NOTHING else value


def _seconds(text: str) -> float:
    for form in ("%d/%m/%Y %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S"):
        try:
            stamp = datetime.datetime.strptime(text, form)
        except ValueError:
            continue
        return stamp.replace(tzinfo=datetime.UTC).timestamp()
    return float("nan")
