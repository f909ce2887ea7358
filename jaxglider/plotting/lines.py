"""Parts that figures share: one line for each run, and plain numbers on axes.

The most restless line of a panel is drawn first, so that a chattering or tumbling run
does not bury the others.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from jaxglider.plotting.series import (
    break_jumps,
    curve,
    degrees,
    drawable,
    restlessness,
)
from jaxglider.plotting.style import Style
from jaxglider.simulation.rollout import Trajectory

UNITS: dict[str, Callable[[Any], np.ndarray]] = {
    "depth": drawable,
    "pitch": degrees,
    "heading": degrees,
    "buoyancy_mass": drawable,
    "mass_position": drawable,
    "mass_angle": degrees,
}
"""Conversion of each signal from its own unit to the unit drawn."""


def choose_run(label: str | None, runs: Mapping[str, Trajectory]) -> str:
    """The label asked for, the last of the runs by default.

    Raises:
        ValueError: there is no such run.
    """
    if not runs:
        raise ValueError("runs must hold at least one trajectory; received none.")
    if label is None:
        return list(runs)[-1]
    if label not in runs:
        raise ValueError(
            f"the run must be one of {', '.join(runs)}; received {label!r}."
        )
    return label


def draw_runs(
    axis: Axes,
    lines: Mapping[str, tuple[np.ndarray, np.ndarray]],
    look: Mapping[str, Style],
    jump: float = np.inf,
) -> None:
    """All the runs' lines, with gaps where one jumps.

    Args:
        axis: axes to draw on.
        lines: times [s] and values by label.
        look: style of each label.
        jump: largest step without a gap, in the unit of the values.
    """
    order = sorted(lines, key=lambda label: -restlessness(lines[label][1]))
    for place, label in enumerate(order):
        time, values = break_jumps(*lines[label], jump)
        curve(
            axis,
            time,
            values,
            color=look[label].colour,
            ls=look[label].dashes,
            label=label,
            zorder=2.0 + place / (len(order) + 1),
        )


def run_handles(look: Mapping[str, Style]) -> list[Line2D]:
    """A line of the legend for each run."""
    return [
        Line2D([], [], color=style.colour, ls=style.dashes, label=label)
        for label, style in look.items()
    ]


def plain_numbers(axis: Axis) -> None:
    """Ticks of a logarithmic axis as 0.8 and 20, not as powers of ten.

    Args:
        axis: horizontal or vertical axis of a panel, its range as drawn.
    """
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    low, high = axis.get_view_interval()
    # Within a decade the ticks between tens are all there is.
    few = high < 10.0 * low
    axis.set_minor_formatter(
        FuncFormatter(lambda value, _: f"{value:.3g}") if few else NullFormatter()
    )
