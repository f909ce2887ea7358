"""Figures of a fit: measured and simulated side by side, and what is left over."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxglider.plotting.style import (
    INK,
    PAGE,
    distinct_styles,
    legend_above,
    look,
    new_figure,
)
from tuning.identification.fitting import Fit
from tuning.identification.record.uniform import since
from tuning.identification.report.report import SHOWN
from tuning.identification.verdict import Verdict

_LABELS = {
    name: (f"{name.replace('_', ' ')} ({unit})", factor)
    for name, (factor, unit) in SHOWN.items()
}
_DIVES = 3


def fit_figure(fit: Fit, verdict: Verdict) -> Figure:
    """Measured and simulated channels of the first dives held out.

    Args:
        fit: the fit.
        verdict: verdict with the simulations.
    """
    flight = fit.flight
    shown = fit.plan.held_out[:_DIVES]
    at = np.isin(flight.dive, shown)
    time = flight.time[at] / 60.0
    names = [n for n in _LABELS if n in verdict.measured or n == "speed"]
    with look():
        figure = new_figure(PAGE, 0.9 + 1.35 * (len(names) + 1))
        axes = figure.subplots(len(names) + 1, 1, sharex=True)
        axes[0].plot(time, flight.depth[at], color=INK)
        axes[0].invert_yaxis()
        axes[0].set_ylabel("depth (m)")
        for axis, name in zip(axes[1:], names, strict=True):
            _compare(axis, name, time, at, fit, verdict)
        axes[-1].set_xlabel("time (min)")
        legend_above(axes[1], axes[1].get_legend_handles_labels()[0])
        figure.align_ylabels()
        numbers = ", ".join(str(n) for n in shown)
        figure.suptitle(f"{_title(fit)}: held-out dives {numbers}", wrap=True)
    return figure


def _title(fit: Fit) -> str:
    return f"{fit.vehicle.name}, {fit.plan.kind} fit"


def _compare(
    axis: Axes,
    name: str,
    time: np.ndarray,
    at: np.ndarray,
    fit: Fit,
    verdict: Verdict,
) -> None:
    label, factor = _LABELS[name]
    fitted, start, _ = distinct_styles(3)
    axis.plot(
        time,
        factor * verdict.before[name][at],
        color=start.colour,
        ls=start.dashes,
        label="before",
    )
    if name in verdict.measured:
        axis.plot(
            time,
            factor * verdict.measured[name][at],
            ".",
            ms=1.5,
            color=INK,
            label="measured",
        )
        seen = verdict.measured[name][at & fit.flight.good]
        seen = factor * seen[np.isfinite(seen)]
        if len(seen):
            low, high = np.percentile(seen, [0.5, 99.5])
            room = 0.25 * (high - low) + 1e-3
            axis.set_ylim(low - room, high + room)
    axis.plot(
        time, factor * verdict.after[name][at], color=fitted.colour, label="fitted"
    )
    axis.set_ylabel(label)


def residuals_figure(fit: Fit, verdict: Verdict) -> Figure:
    """The errors of the held-out dives over depth, time since a turn, and pitch.

    Args:
        fit: the fit.
        verdict: verdict with the simulations.
    """
    flight = fit.flight
    held = np.isin(flight.dive, fit.plan.held_out) & flight.good
    down = flight.depth_rate > 0.0
    # The record begins with a turn, and so does each change of the glide.
    turns = np.diff(down, prepend=not down[0])
    against = (
        ("depth (m)", flight.depth),
        ("time since turn (s)", since(turns, flight.dt)),
        ("recorded pitch (deg)", np.degrees(flight.pitch)),
    )
    names = [n for n in _LABELS if n in verdict.scores]
    with look():
        figure = new_figure(PAGE, 0.7 + 1.5 * len(names))
        grid = np.atleast_2d(figure.subplots(len(names), 3, sharey="row"))
        for row, name in zip(grid, names, strict=True):
            label, factor = _LABELS[name]
            error = factor * (verdict.after[name] - verdict.measured[name])
            for axis, (title, values) in zip(row, against, strict=True):
                _scatter(axis, values, error, held, down)
                axis.set_xlabel(title if name == names[-1] else "")
            row[0].set_ylabel(label)
        legend_above(grid[0, -1], grid[0, -1].get_legend_handles_labels()[0])
        figure.suptitle(
            f"{_title(fit)}: simulated less measured, held-out dives", wrap=True
        )
    return figure


def _scatter(
    axis: Axes, x: np.ndarray, error: np.ndarray, held: np.ndarray, down: np.ndarray
) -> None:
    dive, climb = distinct_styles(2)
    every = max(int(held.sum()) // 3000, 1)
    for flags, style, label in (
        (held & down, dive, "dive"),
        (held & ~down, climb, "climb"),
    ):
        at = np.flatnonzero(flags & np.isfinite(error))[::every]
        axis.plot(x[at], error[at], ".", ms=1.5, color=style.colour, label=label)
    axis.axhline(0.0, color=INK, lw=0.5)
