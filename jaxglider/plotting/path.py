"""Figures of the path: in space and seen from above."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from jaxglider.guidance import WaypointPath
from jaxglider.plotting.lines import run_handles
from jaxglider.plotting.series import active_ticks, curve, drawable, keep_extremes
from jaxglider.plotting.style import FAINT, INK, Style, legend_above, styles
from jaxglider.simulation.origin import Origin
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.tick import TickRecord

_ROUND = np.linspace(0.0, 2.0 * np.pi, 73)
_START: dict[str, Any] = {"marker": "o", "ms": 4, "ls": "none", "color": INK}
_RING: dict[str, Any] = {"marker": "o", "ms": 7, "ls": "none", "mfc": "none"}
_END: dict[str, Any] = {"marker": "D", "ms": 3.5, "ls": "none"}


def path_plan(
    axes: Axes, runs: Mapping[str, Trajectory], path: WaypointPath | None = None
) -> Axes:
    """The way seen from above, east to the right and north up, to one scale.

    Args:
        axes: axes to draw on.
        runs: label to trajectory.
        path: course, drawn with its waypoints, legs and switching circles.
    """
    look = styles(runs)
    if path is not None:
        _plan_of(axes, path)
    for label, style in look.items():
        north, east, _ = _way(active_ticks(runs[label]))
        axes.plot(east, north, color=style.colour, ls=style.dashes, zorder=2)
        for point, marker in _ends([east, north], style):
            axes.plot(*point, **marker, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.set_xlabel("east Y (m)")
    axes.set_ylabel("north X (m)")
    legend_above(axes, _handles(look, path))
    return axes


def path_3d(
    axes: Any, runs: Mapping[str, Trajectory], path: WaypointPath | None = None
) -> Any:
    """The way in space, depth downward, and its shadow; one horizontal scale.

    Waypoints have no depth of their own: each is a pole under its switching circle.

    Args:
        axes: axes made with `projection="3d"`.
        runs: label to trajectory.
        path: course, drawn with its waypoints and switching circles.
    """
    look = styles(runs)
    ways = {label: _way(active_ticks(run)) for label, run in runs.items()}
    depths = np.concatenate([way[2] for way in ways.values()] or [np.zeros(0)])
    deepest = float(np.nanmax(depths)) if np.isfinite(depths).any() else 1.0
    if path is not None:
        _poles_of(axes, path, deepest)
    for label, style in look.items():
        north, east, depth = ways[label]
        floor = np.where(np.isfinite(depth), deepest, np.nan)
        axes.plot(east, north, floor, color=style.colour, lw=0.6, alpha=0.5)
        axes.plot(east, north, depth, color=style.colour, ls=style.dashes)
        for point, marker in _ends([east, north, depth], style):
            axes.plot(*point, **marker)
    axes.set_xlabel("east Y (m)")
    axes.set_ylabel("north X (m)")
    axes.set_zlabel("depth Z (m)")
    axes.invert_zaxis()
    _scale(axes)
    legend_above(axes, _handles(look, None))
    return axes


def depth_over_distance(axes: Axes, runs: Mapping[str, Trajectory]) -> Axes:
    """Depth, downward, against the way over ground.

    Args:
        axes: axes to draw on.
        runs: label to trajectory.
    """
    look = styles(runs)
    longest = 0.0
    for label, style in look.items():
        state = active_ticks(runs[label]).state
        north, east = drawable(state.north), drawable(state.east)
        steps = np.hypot(np.diff(north), np.diff(east))
        way = np.concatenate([np.zeros(min(len(north), 1)), np.cumsum(steps)])
        longest = max(longest, float(np.nanmax(way, initial=0.0)))
        curve(
            axes,
            way,
            drawable(state.depth),
            color=style.colour,
            ls=style.dashes,
            label=label,
        )
    if longest > 0.0:
        axes.set_xlim(0.0, longest)
    axes.invert_yaxis()
    axes.set_xlabel("way over ground (m)")
    axes.set_ylabel("depth Z (m)")
    legend_above(axes, run_handles(look))
    return axes


def on_the_map(path: WaypointPath, origin: Origin) -> WaypointPath:
    """A path at its true position, in double precision: to be drawn, not flown."""
    if not origin.moved:
        return path
    north, east = (np.asarray(x, np.float64) for x in (path.north, path.east))
    start = float(path.start_north), float(path.start_east)
    return eqx.tree_at(
        lambda p: (p.north, p.east, p.start_north, p.start_east),
        path,
        (
            north + origin.north,
            east + origin.east,
            np.float64(start[0] + origin.north),
            np.float64(start[1] + origin.east),
        ),
    )


def _plan_of(axes: Axes, path: WaypointPath) -> None:
    """Legs, waypoints with their numbers, switching circles."""
    corners, radius = _corners(path), float(path.radius)
    axes.plot(corners[1], corners[0], color=INK, ls="--", lw=0.8, zorder=1)
    for number, (north, east) in enumerate(corners[:, 1:].T, start=1):
        axes.add_patch(
            Circle((east, north), radius, fill=False, ec=FAINT, lw=0.7, zorder=1)
        )
        axes.plot(east, north, "s", ms=3, color=INK, zorder=3)
        aside = 0.74 * radius
        axes.annotate(f"{number}", (east + aside, north + aside), color=INK)


def _poles_of(axes: Any, path: WaypointPath, deepest: float) -> None:
    """A switching circle at the surface for each waypoint, and a pole under it."""
    radius = float(path.radius)
    across, along = radius * np.cos(_ROUND), radius * np.sin(_ROUND)
    for north, east in _corners(path)[:, 1:].T:
        axes.plot(east + across, north + along, 0.0 * _ROUND, color=FAINT, lw=0.7)
        axes.plot([east, east], [north, north], [0.0, deepest], color=FAINT, lw=0.7)


def _corners(path: WaypointPath) -> np.ndarray:
    """North and east [m] of the start of the path and of its waypoints, as rows."""
    north = [float(path.start_north), *np.asarray(path.north, dtype=np.float64)]
    east = [float(path.start_east), *np.asarray(path.east, dtype=np.float64)]
    return np.array([north, east])


def _way(ticks: TickRecord) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """North, east and depth [m] of the samples to draw."""
    state = ticks.state
    north, east, depth = (drawable(x) for x in (state.north, state.east, state.depth))
    keep = keep_extremes(north, east, depth)
    return north[keep], east[keep], depth[keep]


def _ends(
    way: Sequence[np.ndarray], style: Style
) -> list[tuple[list[np.ndarray], dict[str, Any]]]:
    """Start and end of a way: a cross at the end if it stopped being finite."""
    known = np.flatnonzero(np.isfinite(np.stack(way)).all(axis=0))
    if not known.size:
        return []
    last = known[-1]
    lost = last < len(way[0]) - 1
    end = {**_END, "color": style.colour, **({"marker": "x", "ms": 5} if lost else {})}
    return [
        ([x[known[:1]] for x in way], _START),
        ([x[last : last + 1] for x in way], end),
    ]


def _handles(look: Mapping[str, Style], path: WaypointPath | None) -> list[Line2D]:
    lines = run_handles(look)
    lines.append(Line2D([], [], **_START, label="start"))
    lines.append(Line2D([], [], **_END, color=FAINT, label="end"))
    if path is not None:
        lines.append(Line2D([], [], color=INK, ls="--", lw=0.8, label="legs"))
        lines.append(Line2D([], [], **_RING, color=FAINT, label="switching radius"))
    return lines


def _scale(axes: Any) -> None:
    """One scale for both horizontal axes, in a box that is neither flat nor thin."""
    horizontal = {"x": axes.get_xlim(), "y": axes.get_ylim()}
    side = max(high - low for low, high in horizontal.values())
    shape = []
    for name, (low, high) in horizontal.items():
        width = max(high - low, 0.6 * side)
        middle = 0.5 * (low + high)
        axes.set(**{f"{name}lim": (middle - 0.5 * width, middle + 0.5 * width)})
        shape.append(width / side)
    bottom, top = axes.get_zlim()
    shape.append(float(np.clip(abs(bottom - top) / side, 0.7, 1.0)))
    axes.set_box_aspect(shape, zoom=0.86)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        # Numbers of less than a metre are longer.
        axis.set_major_locator(MaxNLocator(4 if side > 1.0 else 2))
        axis.set_tick_params(pad=1.0)
        axis.labelpad = 1.0
