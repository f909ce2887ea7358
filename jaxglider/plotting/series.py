"""From a trajectory to what can be drawn: active ticks, degrees, few enough points."""

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.tick import TickRecord

MAX_POINTS = 3000
"""Points drawn of one line; a journal column is some thousand dots wide."""
_ABSURD = 1e12
"""Beyond this modulus a number counts as infinite: Matplotlib's scales overflow."""


def active_ticks(run: Trajectory) -> TickRecord:
    """The ticks before the mission ended, as NumPy arrays."""
    active = np.asarray(run.ticks.active, dtype=bool)
    return jax.tree.map(lambda leaf: np.asarray(leaf)[active], run.ticks)


def drawable(values: Any) -> np.ndarray:
    """The values in double precision, NaN where they are not finite or absurd."""
    array = np.asarray(values, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(array) <= _ABSURD, array, np.nan)


def degrees(angle: Any) -> np.ndarray:
    """An angle [deg] from radians, ready to draw."""
    return drawable(np.degrees(np.asarray(angle, dtype=np.float64)))


def wrapped_degrees(angle: Any) -> np.ndarray:
    """The same angle in [−180, 180) deg, from radians."""
    return np.mod(degrees(angle) + 180.0, 360.0) - 180.0


def continuous_degrees(angle: Any) -> np.ndarray:
    """An angle [deg] from radians without jumps of whole turns.

    It begins in [−180, 180) deg.
    """
    turned = degrees(angle)
    known = np.isfinite(turned)
    turned[known] = np.unwrap(turned[known], period=360.0)
    if known.any():
        first = turned[known][0]
        turned -= first - (np.mod(first + 180.0, 360.0) - 180.0)
    return turned


def end_time(runs: Iterable[Trajectory]) -> float:
    """End of the longest run's last tick [s]; zero without any tick."""
    ends = [0.0]
    for run in runs:
        time = drawable(active_ticks(run).time)
        if time.size:
            ends.append(float(time[-1] + (time[-1] - time[-2] if time.size > 1 else 0)))
    return max(ends)


def keep_extremes(*columns: np.ndarray, points: int = MAX_POINTS) -> np.ndarray:
    """Numbers of the samples to draw: the extremes of each stretch of the run.

    A stretch also keeps one sample that is not finite, so that gaps stay gaps; the
    first and last sample are always kept.

    Args:
        columns: one line's coordinates, of one length.
        points: approximate number of samples to keep at most.
    """
    length = len(columns[0])
    if length <= points:
        return np.arange(length)
    stretches = max(points // (3 * len(columns)), 1)
    size = -(-length // stretches)
    rows = -(-length // size)
    index = np.minimum(np.arange(rows * size), length - 1).reshape(rows, size)
    row = np.arange(rows)
    samples = [np.array([0, length - 1])]
    for column in columns:
        block = column[index]
        known = np.isfinite(block)
        low = np.where(known, block, np.inf).argmin(axis=1)
        high = np.where(known, block, -np.inf).argmax(axis=1)
        gap = ~known.all(axis=1)
        samples += [index[row, low], index[row, high]]
        samples.append(index[row[gap], (~known[gap]).argmax(axis=1)])
    return np.unique(np.concatenate(samples))


def break_jumps(
    time: np.ndarray, values: np.ndarray, jump: float
) -> tuple[np.ndarray, np.ndarray]:
    """The line with a gap wherever it jumps further than `jump`, as wrapped angles do.

    Args:
        time: times of the samples [s].
        values: values, one per time.
        jump: smallest jump, in the unit of the values.
    """
    with np.errstate(invalid="ignore"):
        after = np.flatnonzero(np.abs(np.diff(values)) > jump) + 1
    return np.insert(time, after, time[after]), np.insert(values, after, np.nan)


def curve(axis: Axes, time: np.ndarray, values: np.ndarray, **line: Any) -> Line2D:
    """Draw a line of few points; a cross marks where the run stopped being finite.

    Args:
        axis: axes to draw on.
        time: times of the samples [s].
        values: values, one per time, NaN where unknown.
        line: properties for Matplotlib.
    """
    keep = keep_extremes(values)
    (artist,) = axis.plot(time[keep], values[keep], **line)
    known = np.flatnonzero(np.isfinite(values))
    if known.size and known[-1] < values.size - 1:
        axis.plot(
            time[known[-1]],
            values[known[-1]],
            marker="x",
            markersize=5,
            linestyle="none",
            color=artist.get_color(),
            zorder=artist.get_zorder() + 1,
        )
    return artist


def restlessness(values: np.ndarray) -> float:
    """Total variation; the most restless line is drawn first, under the others."""
    known = values[np.isfinite(values)]
    return float(np.abs(np.diff(known)).sum()) if known.size else 0.0
