"""Figures that compare controllers on one task: tracking and errors."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxglider.plotting.lines import UNITS, choose_run, draw_runs, run_handles
from jaxglider.plotting.series import (
    active_ticks,
    continuous_degrees,
    curve,
    drawable,
    end_time,
    keep_extremes,
    wrapped_degrees,
)
from jaxglider.plotting.style import (
    FAINT,
    INK,
    SHADE,
    flat,
    in_words,
    label_time,
    legend_above,
    off_scale,
    styles,
)
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.tick import TickRecord

_TRACKED = {
    "depth": "depth Z (m)",
    "pitch": "pitch θ (deg)",
    "heading": "heading ψ (deg)",
}
_ERRORS = {
    "depth": "depth error\n(m)",
    "pitch": "pitch error\n(deg)",
    "heading": "heading error\n(deg)",
}
_VISIBLE = {"depth": 0.2, "pitch": 1.0, "heading": 1.0}
"""Smallest visible difference of two references [m, deg]."""
_OUTSIDE = 1.4
"""Largest range of the error axes, in widest funnels."""


def tracking(
    axes: Any, runs: Mapping[str, Trajectory], reference_of: str | None = None
) -> Any:
    """Depth, pitch and heading with their reference.

    The heading drawn is the reference plus the wrapped error, so that a glider that
    rolled or turned many times stays on the page.

    Args:
        axes: three axes, for depth (downward), pitch and heading.
        runs: label to trajectory.
        reference_of: label of the run whose reference is drawn, the last by default.
            Runs have different references where these depend on the glider: the pitch
            on the angle of attack, the heading of a path on the position.
    """
    panels = flat(axes, 3, "tracking")
    ticks = {label: active_ticks(run) for label, run in runs.items()}
    look = styles(runs)
    chosen = choose_run(reference_of, runs)
    own = False
    for axis, (channel, title) in zip(panels, _TRACKED.items(), strict=True):
        aims = {label: _aim(tick, channel) for label, tick in ticks.items()}
        for label, tick in ticks.items():
            time = drawable(tick.time)
            if label == chosen:
                curve(axis, time, aims[label], color=INK, ls="--", lw=0.9, zorder=4)
            elif _differs(aims[label], aims[chosen], channel):
                own = True
                _dash(axis, time, aims[label], look[label].colour)
        lines = {
            label: (drawable(tick.time), _reached(tick, aims[label], channel))
            for label, tick in ticks.items()
        }
        draw_runs(axis, lines, look, _jump(channel))
        axis.set_ylabel(title)
    panels[0].invert_yaxis()
    label_time(panels, end_time(runs.values()))
    name = f"ref. of {chosen}" if own else "reference"
    handles = [Line2D([], [], color=INK, ls="--", lw=0.9, label=name)]
    if own:
        handles.append(
            Line2D([], [], color=FAINT, ls="--", lw=0.6, label="other refs.")
        )
    legend_above(panels[0], [*run_handles(look), *handles])
    return axes


def errors(
    axes: Any, runs: Mapping[str, Trajectory], funnel_of: str | None = None
) -> Any:
    """Errors of depth, pitch and heading inside what is specified.

    A law's own funnel is drawn dash-dotted in its run's colour where it is another.

    Args:
        axes: three axes, for depth, pitch and heading.
        runs: label to trajectory.
        funnel_of: label of the run whose specified funnel is shaded, the last by
            default. Where another run is judged by others they are dotted in its
            colour.
    """
    panels = flat(axes, 3, "errors")
    ticks = {label: active_ticks(run) for label, run in runs.items()}
    look = styles(runs)
    chosen = choose_run(funnel_of, runs)
    shaded = dotted = own = False
    for axis, (channel, title) in zip(panels, _ERRORS.items(), strict=True):
        edges = {label: _funnel(tick, channel) for label, tick in ticks.items()}
        if _exists(edges[chosen]):
            shaded = True
            _shade(axis, *edges[chosen])
        for label, funnel in edges.items():
            if _exists(funnel) and not _agree(funnel, edges[chosen]):
                dotted = True
                _edges(axis, *funnel, look[label].colour, ":")
            of_law = _funnel(ticks[label], channel, "law_limits")
            if _exists(of_law) and not _agree(of_law, funnel):
                own = True
                _edges(axis, *of_law, look[label].colour, "-.")
        lines = {
            label: (drawable(tick.time), UNITS[channel](getattr(tick.error, channel)))
            for label, tick in ticks.items()
        }
        draw_runs(axis, lines, look, _jump(channel))
        axis.axhline(0.0, color=INK, lw=0.5, zorder=1)
        axis.set_ylabel(title)
        _look_at_funnels(axis, lines, edges)
    label_time(panels, end_time(runs.values()))
    handles: list[Artist] = []
    if shaded:
        name = f"specified ({chosen})" if dotted else "specified"
        handles.append(Patch(color=SHADE, label=name))
    if dotted:
        handles.append(
            Line2D([], [], color=FAINT, ls=":", lw=0.9, label="otherwise specified")
        )
    if own:
        name = "law's own funnel"
        handles.append(Line2D([], [], color=FAINT, ls="-.", lw=0.9, label=name))
    legend_above(panels[0], [*run_handles(look), *handles])
    return axes


def _jump(channel: str) -> float:
    return 180.0 if channel == "heading" else np.inf


def _aim(tick: TickRecord, channel: str) -> np.ndarray:
    """Reference of a channel, in the unit drawn."""
    if channel == "heading":
        return continuous_degrees(tick.reference.heading)
    return UNITS[channel](getattr(tick.reference, channel))


def _reached(tick: TickRecord, aim: np.ndarray, channel: str) -> np.ndarray:
    """Output of a channel, in the unit drawn; the heading near its reference."""
    if channel == "heading":
        return aim + wrapped_degrees(tick.error.heading)
    return UNITS[channel](getattr(tick.state, channel))


def _differs(aim: np.ndarray, chosen: np.ndarray, channel: str) -> bool:
    """Whether a reference needs a line of its own: longer, or visibly another one."""
    shared = min(len(aim), len(chosen))
    if len(aim) > shared:
        return True
    with np.errstate(invalid="ignore"):
        apart = np.abs(aim[:shared] - chosen[:shared]) > _VISIBLE[channel]
    return bool(apart.mean() > 0.02) if shared else False


def _look_at_funnels(
    axis: Axes,
    lines: Mapping[str, tuple[np.ndarray, np.ndarray]],
    edges: Mapping[str, Sequence[np.ndarray]],
) -> None:
    """Keep the funnels readable where a run is far outside them."""
    bounds = np.concatenate([np.abs(e) for edge in edges.values() for e in edge[1:]])
    known = bounds[np.isfinite(bounds)]
    if not known.size:
        return
    view = _OUTSIDE * float(known.max())
    largest = {
        label: float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
        for label, (_, values) in lines.items()
    }
    far = [f"{label} {in_words(e)}" for label, e in largest.items() if e > view]
    if far:
        who = ", ".join(far) if len(far) <= 3 else f"{len(far)} runs"
        off_scale(axis, -view, view, f"off scale, max |e|: {who}")


def _funnel(
    tick: TickRecord, channel: str, which: str = "limits"
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s] and both edges of a funnel, NaN where there is none."""
    limits = getattr(getattr(tick, which), channel)
    unit = UNITS[channel]
    return drawable(tick.time), unit(limits.lower), unit(limits.upper)


def _exists(edges: Sequence[np.ndarray]) -> bool:
    """Whether there is a funnel to draw: a controller may have none."""
    return bool(np.isfinite(edges[1]).any())


def _agree(edges: Sequence[np.ndarray], shaded: Sequence[np.ndarray]) -> bool:
    """Whether two funnels are one, as far as both runs last."""
    shared = min(len(edges[0]), len(shaded[0]))
    return all(
        np.allclose(a[:shared], b[:shared], rtol=1e-6, equal_nan=True)
        for a, b in zip(edges[1:], shaded[1:], strict=True)
    )


def _shade(axis: Axes, time: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    keep = keep_extremes(lower, upper)
    axis.fill_between(
        time[keep], lower[keep], upper[keep], color=SHADE, lw=0.0, zorder=0.5
    )


def _dash(axis: Axes, time: np.ndarray, values: np.ndarray, colour: str) -> None:
    curve(axis, time, values, color=colour, ls="--", lw=0.6, alpha=0.8, zorder=1.9)


def _edges(
    axis: Axes,
    time: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    colour: str,
    style: str,
) -> None:
    for edge in (lower, upper):
        curve(axis, time, edge, color=colour, ls=style, lw=0.8, zorder=1.9)
