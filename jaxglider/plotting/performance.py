"""Figure of the performance functions, brought to one initial and one final value."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes

from jaxglider.control.prescribed.performance import AbstractPerformanceFunction
from jaxglider.plotting.style import INK, distinct_styles, legend_above

_LONG_AGO = 1e9
"""A time [s] by which every finite-time performance function has settled."""
_POINTS = 600


def performance_functions(
    axes: Axes,
    functions: Mapping[str, AbstractPerformanceFunction],
    duration: float,
) -> Axes:
    """(P − P_∞)/(P(0) − P_∞) of each function against the time since its restart.

    Normalised because the forms cannot share one P(0): the shape is what is compared.
    A dot marks where each one settles.

    Args:
        axes: axes to draw on.
        functions: label to performance function; settling times may differ.
        duration: length of the time axis [s].
    """
    time = np.linspace(0.0, duration, _POINTS)
    for (label, function), style in zip(
        functions.items(), distinct_styles(len(functions)), strict=True
    ):
        share, settled = _normalised(function, time)
        axes.plot(time, share, color=style.colour, ls=style.dashes, label=label)
        if settled is not None:
            axes.plot(
                settled, 0.0, "o", ms=3.5, color=style.colour, clip_on=False, zorder=5
            )
    axes.axhline(0.0, color=INK, lw=0.5, zorder=1)
    axes.set_xlim(0.0, duration)
    axes.set_ylim(-0.03, 1.05)
    axes.set_xlabel("time since restart t* (s)")
    axes.set_ylabel(r"$(P - P_\infty)\,/\,(P(0) - P_\infty)$")
    legend_above(axes, axes.get_legend_handles_labels()[0])
    return axes


def settling_time(function: AbstractPerformanceFunction, horizon: float) -> float:
    """Settling time of a function [s], or the horizon where that comes first."""
    time = np.linspace(0.0, horizon, 10 * _POINTS)
    settled = _normalised(function, time)[1]
    return horizon if settled is None else settled


def _normalised(
    function: AbstractPerformanceFunction, time: np.ndarray
) -> tuple[np.ndarray, float | None]:
    """The normalised function, and the first of the times at which it has settled."""
    bound = jax.vmap(function)(jnp.asarray([*time, 0.0, _LONG_AGO]))
    value = np.asarray(bound.value, dtype=np.float64)
    start, final = value[-2:]
    settled = np.flatnonzero(np.asarray(bound.settled)[:-2])
    share = (value[:-2] - final) / (start - final)
    return share, float(time[settled[0]]) if settled.size else None
