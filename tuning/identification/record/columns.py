"""Columns of a file turned into channels: names, units and fill values."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from tuning.identification.record.flight_record import Series

DEGREE = np.pi / 180.0
INCH = 0.0254

UNITS: dict[str, float] = {
    "": 1.0,
    "1": 1.0,
    "m": 1.0,
    "mm": 1e-3,
    "cm": 1e-2,
    "in": INCH,
    "rad": 1.0,
    "deg": DEGREE,
    "degree": DEGREE,
    "degrees": DEGREE,
    "degrees_north": DEGREE,
    "degrees_east": DEGREE,
    "Pa": 1.0,
    "dbar": 1e4,
    "decibar": 1e4,
    "bar": 1e5,
    "m^3": 1.0,
    "m3": 1.0,
    "cc": 1e-6,
    "cm^3": 1e-6,
    "cm3": 1e-6,
    "ml": 1e-6,
    "kg/m^3": 1.0,
    "kg m-3": 1.0,
    "kg/m3": 1.0,
    "kg_m3": 1.0,
    "m/s": 1.0,
    "m s-1": 1.0,
    "m_s": 1.0,
    "cm/s": 1e-2,
    "degC": 1.0,
    "celsius": 1.0,
    "degrees_Celsius": 1.0,
    "S/m": 1.0,
    "S m-1": 1.0,
    "S_m": 1.0,
    "mS/cm": 0.1,
    "mS cm-1": 0.1,
    "PSU": 1.0,
    "psu": 1.0,
    "meters": 1.0,
}
"""Factor of each unit to the SI unit of its channel."""


@dataclasses.dataclass(frozen=True)
class Column:
    """Place of a channel in a file.

    Attributes:
        channel: name of the channel.
        names: names of the column, the best first.
        unit: unit of the column, where the file itself does not say.
        convert: function applied after the unit, for what no factor can do.
    """

    channel: str
    names: tuple[str, ...]
    unit: str = ""
    convert: Callable[[np.ndarray], np.ndarray] | None = None

    def series(self, time: np.ndarray, values: np.ndarray, unit: str = "") -> Series:
        """The channel from a column.

        Args:
            time: times of its rows [s].
            values: numbers of the column.
            unit: unit that the file itself gives, if it is known.
        """
        factor = UNITS[unit if unit in UNITS and unit else self.unit]
        result = factor * np.asarray(values, dtype=float)
        if self.convert is not None:
            result = self.convert(result)
        good = np.isfinite(time) & np.isfinite(result)
        return Series(np.asarray(time, dtype=float)[good], result[good])


def channels_of(
    columns: Sequence[Column], table: Mapping[str, np.ndarray], time: np.ndarray
) -> dict[str, Series]:
    """All channels that a table of one clock has.

    Args:
        columns: columns looked for.
        table: numbers by the names of the columns.
        time: times of the rows [s].
    """
    found = {}
    for column in columns:
        name = next((n for n in column.names if n in table), None)
        if name is None or not np.isfinite(table[name]).any():
            continue
        found[column.channel] = column.series(time, table[name])
    return found


def from_nmea(values: np.ndarray) -> np.ndarray:
    """An angle in rad from degrees and minutes written as ddmm.mmm."""
    degrees = np.fix(values / 100.0)
    return DEGREE * (degrees + (values - 100.0 * degrees) / 60.0)


def wrapped(values: np.ndarray) -> np.ndarray:
    """Angles [rad] in [−π, π)."""
    return (values + np.pi) % (2.0 * np.pi) - np.pi
