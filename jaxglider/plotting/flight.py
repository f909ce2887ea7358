"""Figures of a flight of yos: depth by phase, attitude, actuators, and energy."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxglider.files.writing import replacing
from jaxglider.guidance.phases import PHASES
from jaxglider.plotting.lines import UNITS
from jaxglider.plotting.series import (
    active_ticks,
    break_jumps,
    continuous_degrees,
    curve,
    degrees,
    drawable,
    end_time,
    wrapped_degrees,
)
from jaxglider.plotting.style import (
    INK,
    PAGE,
    flat,
    legend_above,
    look,
    new_figure,
    time_unit,
)
from jaxglider.signals import Command
from jaxglider.simulation.flight import halves
from jaxglider.simulation.rollout import Trajectory
from jaxglider.vehicle.actuators import Actuator

MINUTE = 60.0
PANELS = 7
"""Panels of a dive: depth, three angles, three actuators."""
PHASE_COLOURS = ("#56B4E9", "#0072B2", "#E69F00", "#D55E00", "#009E73")
"""Colours of the phases in their order: told apart with every kind of colour vision."""
_CONSUMERS = {
    "hotel": "#999999",
    "surface": "#56B4E9",
    "communication": "#CC79A7",
    "pump": "#0072B2",
    "position": "#E69F00",
    "steering": "#D55E00",
}
_TITLES = {
    "buoyancy_mass": "ballast\n$m_b$ (kg)",
    "mass_position": "battery\n$r_{p1}$ (m)",
    "mass_angle": "steering\n(deg)",
}


def flight(axes: Any, run: Trajectory, actuators: Command[Actuator]) -> Any:
    """Depth coloured by phase, attitude against wanted, and the actuators.

    Args:
        axes: six axes above each other.
        run: trajectory with phases.
        actuators: actuators of the scenario; their limits are drawn.
    """
    ticks = active_ticks(run)
    unit, label = time_unit(end_time([run]), MINUTE)
    return _panels(axes, ticks, drawable(ticks.time) / unit, label, actuators)


def dive(
    axes: Any, run: Trajectory, actuators: Command[Actuator], span: slice, title: str
) -> Any:
    """The same for one yo, with its roll, in minutes from its start.

    Args:
        axes: seven axes above each other.
        run: trajectory with phases.
        actuators: actuators of the scenario; their limits are drawn.
        span: ticks of the yo, a row of `dive_spans`.
        title: line that stands above.
    """
    ticks = jax.tree.map(lambda x: np.asarray(x)[span], run.ticks)
    minutes = (drawable(ticks.time) - float(ticks.time[0])) / MINUTE
    _panels(axes, ticks, minutes, "time (min)", actuators)
    figure: Any = flat(axes, PANELS, "dive")[0].figure
    figure.suptitle(title, wrap=True)
    return axes


def save_dives(
    path: Path, run: Trajectory, actuators: Command[Actuator], title: str
) -> int:
    """Write a PDF with a page for each dive and its climb; none without dives.

    Args:
        path: file to write.
        run: trajectory with phases.
        actuators: actuators of the scenario.
        title: name of what was flown, such as mission and law.

    Returns:
        The number of pages.
    """
    if run.ticks.phase is None or not dive_spans(run):
        return 0
    count = 0
    with look(), replacing(path) as temporary, PdfPages(temporary) as pages:
        for page in dive_pages(run, actuators, title):
            pages.savefig(page)
            page.clear()
            count += 1
    return count


def dive_pages(
    run: Trajectory, actuators: Command[Actuator], title: str
) -> Iterator[Figure]:
    """A page for each dive and its climb, one at a time.

    Args:
        run: trajectory with phases.
        actuators: actuators of the scenario.
        title: name of what was flown, such as mission and law.
    """
    for number, span in enumerate(dive_spans(run), 1):
        figure = new_figure(PAGE, 9.4)
        axes = figure.subplots(PANELS, 1, sharex=True)
        dive(axes, run, actuators, span, f"{title}, dive {number}")
        figure.align_ylabels()
        yield figure


def dive_spans(run: Trajectory) -> list[slice]:
    """Ticks of each yo, from the inflection at the top to the end of the climb."""
    rows, time = halves(run), np.asarray(run.ticks.time)
    starts = [row["start_s"] for row in rows if row["half"] == "dive"]
    end = rows[-1]["start_s"] + rows[-1]["duration_s"] if rows else 0.0
    edges = np.searchsorted(time, [*starts, end])
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]


def _panels(
    axes: Any, ticks: Any, time: np.ndarray, unit: str, actuators: Command[Actuator]
) -> Any:
    """The panels of a mission, or of a part of it; seven have one for the roll."""
    count = np.size(axes)
    panels = flat(axes, PANELS if count == PANELS else PANELS - 1, "flight")
    phase, depth = np.asarray(ticks.phase), drawable(ticks.state.depth)
    handles: list[Line2D] = []
    for number in np.unique(phase).astype(int):
        # A line ends where the next one begins: one tick longer than its phase.
        own = phase == number
        own |= np.concatenate([[False], own[:-1]])
        colour, name = PHASE_COLOURS[number], PHASES[number]
        shown = np.where(own, depth, np.nan)
        handles += panels[0].plot(time, shown, color=colour, label=name)
    panels[0].invert_yaxis()
    panels[0].set_ylabel("depth (m)")
    _attitude(panels[1:-3], ticks, time)
    for axis, (name, title) in zip(panels[-3:], _TITLES.items(), strict=True):
        scale, one = UNITS[name], getattr(actuators, name)
        limit = float(scale(one.limit))
        for side in (-limit, limit):
            axis.axhline(side, color=INK, lw=0.8, ls=(0, (1, 1.5)))
        curve(axis, time, scale(getattr(ticks.applied, name)), color=INK, lw=0.8)
        axis.set_ylim(-1.15 * limit, 1.15 * limit)
        axis.set_ylabel(title)
    panels[-1].set_xlabel(unit)
    panels[-1].set_xlim(0.0, max(float(time[-1]), 1e-3) if time.size else 1.0)
    wanted = Line2D([], [], color=INK, lw=0.8, ls=(0, (4, 2)), label="wanted")
    limits = Line2D([], [], color=INK, lw=0.8, ls=(0, (1, 1.5)), label="limit")
    legend_above(panels[0], [*handles, wanted, limits])
    return axes


def _attitude(panels: Any, ticks: Any, time: np.ndarray) -> None:
    """Pitch, roll where there is room, heading, and what is wanted of them."""
    course = continuous_degrees(ticks.reference.heading)
    rows = {
        "pitch (deg)": (degrees(ticks.state.pitch), degrees(ticks.reference.pitch)),
        "roll (deg)": (degrees(ticks.state.roll), None),
        # Near its reference, so that no line jumps at half a turn.
        "heading (deg)": (course + wrapped_degrees(ticks.error.heading), course),
    }
    if len(panels) < len(rows):
        del rows["roll (deg)"]
    for axis, (title, (reached, wanted)) in zip(panels, rows.items(), strict=True):
        line = break_jumps(time, reached, 180.0)
        axis.plot(*line, color="#0072B2", lw=0.8)
        if wanted is not None:
            axis.plot(time, wanted, color=INK, lw=0.8, ls=(0, (4, 2)))
        axis.set_ylabel(title)


def energy(axis: Any, run: Trajectory) -> Any:
    """Energy spent so far, by who took it, one upon the other.

    Args:
        axis: axes to draw on.
        run: trajectory with an account of energy.
    """
    ticks = active_ticks(run)
    time = drawable(ticks.time)
    columns = [drawable(getattr(ticks.energy, name)) / 1e3 for name in _CONSUMERS]
    flown = run.metrics.flight
    if flown is not None and time.size:
        # Records are of the start of a tick: the last one's share is in the sums.
        spent = [float(getattr(flown.energy, name)) / 1e3 for name in _CONSUMERS]
        time = np.append(time, float(run.metrics.end_time))
        columns = [np.append(c, end) for c, end in zip(columns, spent, strict=True)]
    unit, label = time_unit(end_time([run]), MINUTE)
    time = time / unit
    axis.stackplot(time, columns, colors=list(_CONSUMERS.values()), lw=0.0)
    axis.set_ylabel("energy (kJ)")
    axis.set_xlabel(label)
    if time.size > 1:
        axis.set_xlim(0.0, float(time[-1]))
    axis.set_ylim(bottom=0.0)
    handles = [
        Line2D([], [], color=colour, lw=5.0, label=f"{name} {column[-1]:.3g} kJ")
        for (name, colour), column in zip(_CONSUMERS.items(), columns, strict=True)
        if column.size and column[-1] > 0.0
    ]
    legend_above(axis, handles)
    return axis
