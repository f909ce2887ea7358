"""A flight record in SI units: one series for each channel, each with its own times.

Instruments have clocks of their own, so nothing is put on common times here; that is
done once, where a fit begins (`uniform`).

Conventions: pitch positive nose up, roll positive to starboard, ballast is the volume
that the engine has pushed out (more volume rises), the mass position is positive
forward, depth positive down.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

CHANNELS: dict[str, tuple[str, str]] = {
    "pressure": ("Pa", "pressure above that of the air"),
    "depth": ("m", "depth, positive down"),
    "pitch": ("rad", "pitch, positive nose up"),
    "roll": ("rad", "roll, positive to starboard"),
    "heading": ("rad", "heading, clockwise from north"),
    "ballast": ("m^3", "volume pushed out by the engine, more of it rises"),
    "mass_position": ("m", "moving mass along the axis, positive forward"),
    "mass_angle": ("rad", "roll angle of the moving mass"),
    "fin": ("rad", "angle of the fin"),
    "wanted_heading": ("rad", "heading that the autopilot was told"),
    "speed": ("m/s", "speed through the water, measured"),
    "density": ("kg/m^3", "density of the water where the glider is"),
    "temperature": ("degC", "temperature of the water"),
    "conductivity": ("S/m", "conductivity of the water"),
    "salinity": ("1", "practical salinity"),
    "latitude": ("rad", "latitude, positive north"),
    "longitude": ("rad", "longitude, positive east"),
}
"""Unit and meaning of each channel of a record."""

RANGES: dict[str, tuple[float, float]] = {
    "pressure": (-2e5, 1.2e8),
    "depth": (-20.0, 1.2e4),
    "pitch": (-1.6, 1.6),
    "roll": (-3.2, 3.2),
    "heading": (-6.3, 6.3),
    "ballast": (-5e-3, 5e-3),
    "mass_position": (-0.3, 0.3),
    "mass_angle": (-3.2, 3.2),
    "fin": (-1.6, 1.6),
    "wanted_heading": (-6.3, 6.3),
    "speed": (0.0, 3.0),
    "density": (950.0, 1100.0),
    "temperature": (-3.0, 45.0),
    "conductivity": (0.0, 10.0),
    "salinity": (0.0, 45.0),
    "latitude": (-1.5708, 1.5708),
    "longitude": (-6.2832, 6.2832),
}
"""Smallest and largest credible value of each channel, in its unit."""


@dataclasses.dataclass(frozen=True)
class Series:
    """Values of one channel.

    Attributes:
        time: times [s] since 1970, or since any other start that the whole record has.
        values: values, in the unit of the channel.
    """

    time: np.ndarray
    values: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    def interval(self) -> float:
        """Median time between samples [s]; infinite for fewer than two."""
        return float(np.median(np.diff(self.time))) if len(self) > 1 else float("inf")


def joined(parts: Sequence[Series]) -> Series:
    """Series of one channel, one behind the other.

    Args:
        parts: series, at least one.
    """
    return Series(
        np.concatenate([s.time for s in parts]),
        np.concatenate([s.values for s in parts]),
    )


@dataclasses.dataclass(frozen=True)
class Finding:
    """Something noticed in a record.

    Attributes:
        channel: name of the channel, or of the file where it concerns all of it.
        text: sentence that says what was found and what was done.
        warning: whether a fit should not be believed before somebody has looked.
    """

    channel: str
    text: str
    warning: bool = False


@dataclasses.dataclass(frozen=True)
class FlightRecord:
    """A flight as its instruments recorded it.

    Attributes:
        name: name of the record, of its files.
        kind: format it was read from.
        channels: series by the names of `CHANNELS`; those not recorded are missing.
        findings: findings of the reader and of the cleaning.
        digest: SHA-256 of the bytes of all its files.
    """

    name: str
    kind: str
    channels: Mapping[str, Series]
    findings: tuple[Finding, ...] = ()
    digest: str = ""

    def __post_init__(self) -> None:
        unknown = sorted(set(self.channels) - set(CHANNELS))
        if unknown:
            raise ValueError(
                f"channels must be among {', '.join(CHANNELS)}; received "
                f"{unknown[0]!r}."
            )

    def has(self, *names: str) -> bool:
        """Whether all these channels are recorded."""
        return all(name in self.channels for name in names)

    def span(self) -> tuple[float, float]:
        """First and last time of any channel [s]; zeros for an empty record."""
        series = [s for s in self.channels.values() if len(s)]
        if not series:
            return 0.0, 0.0
        return min(s.time[0] for s in series), max(s.time[-1] for s in series)

    def warnings(self) -> list[str]:
        """The findings that somebody must look at, as text."""
        return [f"{f.channel}: {f.text}" for f in self.findings if f.warning]

    def with_findings(self, more: Iterable[Finding]) -> "FlightRecord":
        """The same record with more findings."""
        return dataclasses.replace(self, findings=(*self.findings, *more))
