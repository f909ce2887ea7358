"""Figures of what a glider with sensors knew: its place, and its motion."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from jaxglider.guidance import WaypointPath
from jaxglider.plotting.series import (
    active_ticks,
    break_jumps,
    degrees,
    drawable,
    end_time,
)
from jaxglider.plotting.style import FAINT, INK, flat, legend_above, time_unit
from jaxglider.simulation.rollout import Trajectory

TRUE, KNOWN, FIX = "#0072B2", "#D55E00", "#009E73"
"""Colours of the truth, of what is known on board, and of fixes."""
_JUMP = 20.0
"""Distance beyond which a reckoned position has been set anew by a fix [m]."""


def reckoned_map(axes: Axes, run: Trajectory, path: WaypointPath | None) -> Axes:
    """The true way, the reckoned one and the fixes, seen from above.

    Args:
        axes: axes to draw on.
        run: trajectory of a glider with sensors.
        path: course, its waypoints are drawn; or None.
    """
    ticks = active_ticks(run)
    onboard: Any = ticks.onboard
    known = onboard.estimate
    axes.plot(drawable(ticks.state.east), drawable(ticks.state.north), color=TRUE)
    east, north = drawable(known.east), drawable(known.north)
    jumps = np.hypot(np.diff(east), np.diff(north)) > _JUMP
    for part in np.split(np.arange(len(east)), np.flatnonzero(jumps) + 1):
        axes.plot(east[part], north[part], color=KNOWN, ls=(0, (4, 1.5)))
    fix_north, fix_east = (drawable(x) for x in onboard.fix)
    axes.plot(fix_east, fix_north, "+", color=FIX, ms=5)
    handles = [
        Line2D([], [], color=TRUE, label="true"),
        Line2D([], [], color=KNOWN, ls=(0, (4, 1.5)), label="reckoned"),
        Line2D([], [], color=FIX, marker="+", ls="none", label="fixed"),
    ]
    if path is not None:
        axes.plot(np.asarray(path.east), np.asarray(path.north), "s", ms=4, color=INK)
        handles.append(
            Line2D([], [], color=INK, marker="s", ls="none", ms=4, label="waypoint")
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east Y (m)")
    axes.set_ylabel("north X (m)")
    legend_above(axes, handles)
    return axes


def estimates(axes: Any, run: Trajectory) -> Any:
    """Depth rate and its error, surge, and errors of pitch and heading.

    The true surge is that over ground: a current parts it from the estimated one, which
    is through the water.

    Args:
        axes: four axes above each other.
        run: trajectory of a glider with sensors.
    """
    panels = flat(axes, 4, "estimates")
    ticks = active_ticks(run)
    unit, label = time_unit(end_time([run]), 60.0)
    time = drawable(ticks.time) / unit
    onboard: Any = ticks.onboard
    truth, known = ticks.state, onboard.estimate
    rates = [_depth_rate(s) for s in (truth, known)]
    for values, colour in zip(rates, (TRUE, KNOWN), strict=True):
        panels[0].plot(time, 100.0 * values, color=colour, lw=0.8)
    panels[0].set_ylabel("depth rate\n(cm/s)")
    panels[1].plot(time, 100.0 * (rates[1] - rates[0]), color=INK, lw=0.8)
    panels[1].set_ylabel("its error\n(cm/s)")
    for state, colour in ((truth, TRUE), (known, KNOWN)):
        panels[2].plot(time, 100.0 * drawable(state.surge), color=colour, lw=0.8)
    panels[2].set_ylabel("surge\n(cm/s)")
    for name, colour in (("pitch", INK), ("heading", FAINT)):
        wrong = degrees(getattr(known, name)) - degrees(getattr(truth, name))
        wrong = (wrong + 180.0) % 360.0 - 180.0
        panels[3].plot(*break_jumps(time, wrong, 180.0), color=colour, lw=0.8)
    panels[3].set_ylabel("error (deg)")
    panels[3].set_xlabel(label)
    if time.size > 1:
        panels[3].set_xlim(0.0, float(time[-1]))
    legend_above(
        panels[0],
        [
            Line2D([], [], color=TRUE, label="true"),
            Line2D([], [], color=KNOWN, label="estimated"),
            Line2D([], [], color=INK, label="pitch"),
            Line2D([], [], color=FAINT, label="heading"),
        ],
    )
    return axes


def _depth_rate(state: Any) -> np.ndarray:
    """Z' [m/s]."""
    names = ("roll", "pitch", "surge", "sway", "heave")
    roll, pitch, surge, sway, heave = (drawable(getattr(state, n)) for n in names)
    down = np.sin(roll) * sway + np.cos(roll) * heave
    return np.cos(pitch) * down - np.sin(pitch) * surge
