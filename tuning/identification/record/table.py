"""A record as plain CSV, for any glider: the unit stands in the name of each column.

The first line names the columns, `time_s` among them; others are a channel and its
unit, `pressure_bar`, `pitch_deg`, `ballast_cc`. Lines that begin with # are remarks. An
empty cell is no sample.
"""

import csv
from pathlib import Path

import numpy as np

from jaxglider.core.toml import file_text
from tuning.identification.record.columns import UNITS
from tuning.identification.record.flight_record import CHANNELS, FlightRecord, Series

TIME = "time_s"
"""Name of the column of times."""


def read_csv(path: Path) -> FlightRecord:
    """A flight from a table with units in its heads.

    Args:
        path: path of the file.

    Raises:
        ValueError: a column has no known name or unit, or a cell is no number.
        OSError: the file cannot be read.
    """
    lines = [
        line for line in file_text(path).splitlines() if line and line[0] not in "#"
    ]
    rows = list(csv.reader(lines))
    if len(rows) < 2 or TIME not in rows[0]:
        raise ValueError(
            f"{path}: the first line must name columns, {TIME} among them, and samples "
            f"must follow; received {len(rows)} lines."
        )
    head, body = rows[0], rows[1:]
    short = next((n for n, row in enumerate(body, 2) if len(row) != len(head)), None)
    if short is not None:
        raise ValueError(
            f"{path}: every line must have {len(head)} cells; line {short} below the "
            "remarks has another number. Is the file complete?"
        )
    numbers = {
        name: _numbers(path, name, [row[n] for row in body])
        for n, name in enumerate(head)
    }
    time = numbers.pop(TIME)
    channels = {}
    for name, values in numbers.items():
        channel, factor = _channel(path, name)
        good = np.isfinite(values) & np.isfinite(time)
        channels[channel] = Series(time[good], factor * values[good])
    return FlightRecord(path.stem, "table", channels)


def _channel(path: Path, name: str) -> tuple[str, float]:
    """The channel that a column is, and the factor of its unit."""
    for channel in sorted(CHANNELS, key=len, reverse=True):
        if name == channel or name.startswith(channel + "_"):
            unit = name[len(channel) + 1 :]
            dimension = CHANNELS[channel][0]
            if unit in UNITS and (unit or dimension == "1"):
                return channel, UNITS[unit]
            raise ValueError(
                f"{path}: column {name!r} must end in a unit of {channel}, such as "
                f"{channel}_{dimension.replace('/', '_').replace('^', '')}; known are "
                f"{', '.join(u for u in UNITS if u and ' ' not in u and '/' not in u)}."
            )
    raise ValueError(
        f"{path}: column {name!r} is no channel; use {TIME} and, with their units, "
        f"{', '.join(CHANNELS)}."
    )


def _numbers(path: Path, name: str, cells: list[str]) -> np.ndarray:
    try:
        return np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    except ValueError as error:
        raise ValueError(f"{path}: column {name}: {error}.") from error
