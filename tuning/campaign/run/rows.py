"""Rows of a campaign: one member each, its uncertain numbers and its results.

`metrics` has an axis of sets of gains and one of columns; numbers are kept in double
precision, which holds single precision exactly.
"""

import dataclasses
import zlib
from operator import attrgetter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.files.flight.flight_variables import FLIGHT_UNITS
from jaxglider.guidance.phases import COMPLETED, STATUSES
from jaxglider.signals import (
    CHANNEL_UNITS,
    CHANNELS,
    COMMAND_UNITS,
    BodyAxes,
    Channels,
    GliderState,
    zeros,
)
from jaxglider.simulation.flight import FlightMetrics
from jaxglider.simulation.metrics import ChannelMetrics, Metrics, empty_sums, finish
from jaxglider.simulation.specification import Specification
from jaxglider.vehicle.energy import Consumers
from tuning.reporting.violations import violations
from tuning.reporting.witness import Witness

_EFFORTS = dict(zip(CHANNELS, COMMAND_UNITS.values(), strict=True))
"""Unit of the command that belongs to each channel."""

AXES = tuple(field.name for field in dataclasses.fields(BodyAxes))
MEASURES = tuple(field.name for field in dataclasses.fields(ChannelMetrics))
OUTCOMES = tuple(
    f.name
    for f in dataclasses.fields(Metrics)
    if f.name not in ("channels", "status", "flight", "navigation")
)
FLAGS = ("finite", "capsized")
METRIC_COLUMNS = (*(f"{c}.{m}" for c in CHANNELS for m in MEASURES), *OUTCOMES)
_WATCHED = {
    **{
        f"{channel}.{name}": f"{part}.{channel}"
        for name, part in (("law_restart_peak", "at_restart"), ("law_peak", "nearness"))
        for channel in CHANNELS
    },
    **{
        f"{part}_{axis}": f"{part}.{axis}"
        for part in ("disturbance", "disturbance_rate", "late_error")
        for axis in AXES
    },
}
"""Columns of what the theorem's assumptions are judged by: name, path in a witness."""
_NAMES = {path: name for name, path in _WATCHED.items()}
COLUMNS = (*METRIC_COLUMNS, *_WATCHED)
"""Names of what is kept of a run, in the order of the rows."""
_BY_CONSUMER = tuple(f"energy.{f.name}" for f in dataclasses.fields(Consumers))
_BY_ACTUATOR = tuple(
    f"{x}.{name}" for x in ("moves", "travel") for name in COMMAND_UNITS
)
_PLAIN = tuple(
    f.name
    for f in dataclasses.fields(FlightMetrics)
    if f.name not in ("energy", "moves", "travel")
)
FLIGHT_COLUMNS = (
    "status",
    *(f"flight.{name}" for name in (*_PLAIN, *_BY_CONSUMER, *_BY_ACTUATOR)),
)
"""Names of what is kept of a flight of yos besides, after the others."""
ALL_COLUMNS = (*COLUMNS, *FLIGHT_COLUMNS)


def columns_of(*, flight: bool) -> tuple[str, ...]:
    """Names of what is kept of a run, of a flight of yos or of another."""
    return ALL_COLUMNS if flight else COLUMNS


MAY_LACK = ("max_error_settled",)
"""Measures that are NaN in a sound run: it may end before its funnel settles."""


def flatten(metrics: Metrics, witness: Witness | None = None) -> np.ndarray:
    """Metrics with leading axes as numbers, columns last, and what was witnessed.

    Args:
        metrics: metrics of runs.
        witness: witness of the same runs; None for `METRIC_COLUMNS` alone.
    """
    paths = [f"channels.{name}" if "." in name else name for name in METRIC_COLUMNS]
    columns = [attrgetter(path)(metrics) for path in paths]
    if witness is not None:
        columns += [attrgetter(path)(witness) for path in _WATCHED.values()]
        if metrics.status is not None:
            columns += [attrgetter(path)(metrics) for path in FLIGHT_COLUMNS]
    return np.stack([np.asarray(x, np.float64) for x in columns], axis=-1)


def metrics_and_witness(values: np.ndarray) -> tuple[Metrics, Witness]:
    """The inverse of `flatten`, from rows with columns last."""
    # Built from empty ones: fields are numbers, and these are arrays of them.
    zero = jnp.zeros(())
    empty = finish(empty_sums(zero), GliderState.at_rest(), zero.astype(int), zero)
    axes, channels = zeros(BodyAxes, zero), zeros(Channels, zero)
    kinds = empty, Witness(channels, channels, axes, axes, axes)
    column = {name: values[..., n] for n, name in enumerate(COLUMNS)}

    def filled(path: Any, _: Any) -> np.ndarray:
        words = [part.name for part in path[1:]]
        name = ".".join(words[1:] if words[0] == "channels" else words)
        found = column[_NAMES.get(name, name)]
        return found == 1.0 if name in FLAGS else found

    metrics, witness = jax.tree_util.tree_map_with_path(filled, kinds)
    return metrics, witness


def unit(column: str) -> str:
    """SI unit of a column."""
    # The roll of the glider, not the moment about the roll axis.
    whole = {"end_time": "s", "max_roll": "rad", "max_pitch": "rad"}
    if column in whole:
        return whole[column]
    channel, _, measure = column.rpartition(".")
    if channel.startswith("flight"):
        if channel == "flight.travel":
            return COMMAND_UNITS[measure]
        name = "energy" if channel == "flight.energy" else measure
        return FLIGHT_UNITS.get(name, "1").replace("_", "/")
    if measure in ("max_error", "max_error_settled", "rms_error"):
        return CHANNEL_UNITS[channel]
    if measure in ("rms_effort", "chattering", "travel"):
        return _EFFORTS[channel]
    for axis in AXES:
        if column.endswith(f"_{axis}"):
            force = "N" if axis in AXES[:3] else "N m"
            return f"{force}/s" if "rate" in column else force
    return "1"


def row_type(quantities: int, gains: int, columns: int = len(COLUMNS)) -> np.dtype:
    """Type of the rows of a campaign.

    Args:
        quantities: number of uncertain numbers.
        gains: number of sets of gains that are compared.
        columns: number of what is kept of a run.
    """
    return np.dtype(
        [
            ("member", "<i8"),
            ("values", "<f8", (quantities,)),
            ("metrics", "<f8", (gains, columns)),
            ("check", "<u4"),
        ]
    )


def make_rows(first: int, values: np.ndarray, metrics: np.ndarray) -> np.ndarray:
    """Rows of members `first`, `first + 1` and so on, with their check sums.

    Args:
        first: number of the first member.
        values: values of the uncertain numbers, one row a member.
        metrics: results, with axes of member, set of gains and column.
    """
    rows = np.zeros(len(values), row_type(values.shape[1], *metrics.shape[1:]))
    rows["member"] = np.arange(first, first + len(values))
    rows["values"], rows["metrics"] = values, metrics
    rows["check"] = checksums(rows)
    return rows


def checksums(rows: np.ndarray) -> np.ndarray:
    """CRC-32 of each row, but for the sum itself."""
    size = rows.dtype.itemsize
    data = np.ascontiguousarray(rows).tobytes()
    length = size - rows.dtype["check"].itemsize
    sums = [zlib.crc32(data[at : at + length]) for at in range(0, len(data), size)]
    return np.asarray(sums, np.uint32)


class Rows:
    """Rows read by column, runs that became non-finite never left out.

    A number of a run that became non-finite counts as infinite, the worst there is.

    Attributes:
        rows: rows of the campaign, in the order of the members.
        labels: labels of the sets of gains.
    """

    def __init__(self, rows: np.ndarray, labels: tuple[str, ...]) -> None:
        """Look at rows.

        Args:
            rows: rows, which may be mapped from a file.
            labels: labels of the sets of gains.
        """
        self.rows, self.labels = rows, labels

    def __len__(self) -> int:
        return len(self.rows)

    def raw(self, gains: int, name: str) -> np.ndarray:
        """A column as it was computed, NaN and all."""
        return np.array(self.rows["metrics"][:, gains, ALL_COLUMNS.index(name)])

    @property
    def has_flight(self) -> bool:
        """Whether yos were flown."""
        return bool(self.rows["metrics"].shape[-1] == len(ALL_COLUMNS))

    def ends(self, gains: int) -> dict[str, int]:
        """Number of members by the end of their mission; none without yos.

        Those that became non-finite are counted as such, whatever end they had.
        """
        if not self.has_flight:
            return {}
        failed = self.failed(gains)
        numbers = np.where(failed, -1, self.raw(gains, "status"))
        counts = {name: int(np.sum(numbers == n)) for n, name in enumerate(STATUSES)}
        counts["not finite"] = int(np.sum(failed))
        return {name: count for name, count in counts.items() if count}

    def ended(self, gains: int, name: str) -> np.ndarray:
        """Flags of the members whose mission ended so, or failed."""
        return self.failed(gains) | (self.raw(gains, "status") == STATUSES.index(name))

    def failed(self, gains: int) -> np.ndarray:
        """Flags of the runs that became non-finite."""
        return self.raw(gains, "finite") != 1.0

    def column(self, gains: int, name: str) -> np.ndarray:
        """A column with infinity for every run that failed.

        A measure that a sound run may lack stays NaN: it is neither good nor bad.
        """
        values = self.raw(gains, name)
        sound = np.isfinite(values)
        if name.rpartition(".")[2] in MAY_LACK or name.startswith("flight."):
            sound |= np.isnan(values)
        return np.where(self.failed(gains) | ~sound, np.inf, values)

    def left_funnel(self, gains: int, channel: str | None = None) -> np.ndarray:
        """Flags of members that left the funnel of one channel or any; failures did."""
        named = CHANNELS if channel is None else (channel,)
        outside = [self.column(gains, f"{c}.time_outside_funnel") > 0.0 for c in named]
        return np.logical_or.reduce(outside)

    def violations(
        self, gains: int, specification: Specification | None
    ) -> dict[str, np.ndarray]:
        """Flags of members that break each part of a specification; failures do."""
        return violations(
            lambda name: self.column(gains, name), self.failed(gains), specification
        )

    def capsized(self, gains: int) -> np.ndarray:
        """Flags of the members that rolled past 90 degrees; failures did."""
        return self.failed(gains) | (self.raw(gains, "capsized") == 1.0)

    def unfinished(self, gains: int, waypoints: int | None) -> np.ndarray:
        """Flags of members that missed the last waypoint in time; failures did too."""
        failed = self.failed(gains)
        if self.has_flight:
            return failed | (self.raw(gains, "status") != COMPLETED)
        if waypoints is None:
            return failed
        return failed | (self.raw(gains, "waypoints_reached") < waypoints)
