"""Figures of a flight of yos: depth by phase, attitude, actuators, and energy."""

from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from jaxglider.guidance.phases import PHASES
from jaxglider.plotting.lines import UNITS
from jaxglider.plotting.series import (
    active_ticks,
    break_jumps,
    continuous_degrees,
    curve,
    degrees,
    drawable,
    wrapped_degrees,
)
from jaxglider.plotting.style import INK, flat, legend_above
from jaxglider.signals import Command
from jaxglider.simulation.rollout import Trajectory
from jaxglider.vehicle.actuators import Actuator

HOUR = 3600.0
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
    """Depth coloured by phase, pitch and heading against wanted, and the actuators.

    Args:
        axes: six axes above each other.
        run: trajectory with phases.
        actuators: actuators of the scenario; their limits are drawn.
    """
    panels = flat(axes, 6, "flight")
    ticks = active_ticks(run)
    hours = drawable(ticks.time) / HOUR
    phase, depth = np.asarray(ticks.phase), drawable(ticks.state.depth)
    for number in range(len(PHASES)):
        # A line ends where the next one begins: one tick longer than its phase.
        own = phase == number
        own |= np.concatenate([[False], own[:-1]])
        colour = PHASE_COLOURS[number]
        panels[0].plot(hours, np.where(own, depth, np.nan), color=colour)
    panels[0].invert_yaxis()
    panels[0].set_ylabel("depth (m)")
    _attitude(panels[1:3], ticks, hours)
    for axis, (name, title) in zip(panels[3:], _TITLES.items(), strict=True):
        unit, one = UNITS[name], getattr(actuators, name)
        limit = float(unit(one.limit))
        for side in (-limit, limit):
            axis.axhline(side, color=INK, lw=0.8, ls=(0, (1, 1.5)))
        curve(axis, hours, unit(getattr(ticks.applied, name)), color=INK, lw=0.8)
        axis.set_ylim(-1.15 * limit, 1.15 * limit)
        axis.set_ylabel(title)
    panels[-1].set_xlabel("time (h)")
    panels[-1].set_xlim(0.0, max(float(hours[-1]), 1e-3) if hours.size else 1.0)
    handles = [
        Line2D([], [], color=colour, label=name)
        for name, colour in zip(PHASES, PHASE_COLOURS, strict=True)
    ]
    wanted = Line2D([], [], color=INK, lw=0.8, ls=(0, (4, 2)), label="wanted")
    limits = Line2D([], [], color=INK, lw=0.8, ls=(0, (1, 1.5)), label="limit")
    legend_above(panels[0], [*handles, wanted, limits])
    return axes


def _attitude(panels: Any, ticks: Any, hours: np.ndarray) -> None:
    """Pitch and heading, and what is wanted of them."""
    course = continuous_degrees(ticks.reference.heading)
    rows = {
        "pitch (deg)": (degrees(ticks.state.pitch), degrees(ticks.reference.pitch)),
        # Near its reference, so that no line jumps at half a turn.
        "heading (deg)": (course + wrapped_degrees(ticks.error.heading), course),
    }
    for axis, (title, (reached, wanted)) in zip(panels, rows.items(), strict=True):
        line = break_jumps(hours, reached, 180.0)
        axis.plot(*line, color="#0072B2", lw=0.8)
        axis.plot(hours, wanted, color=INK, lw=0.8, ls=(0, (4, 2)))
        axis.set_ylabel(title)


def energy(axis: Any, run: Trajectory) -> Any:
    """Energy spent so far, by who took it, one upon the other.

    Args:
        axis: axes to draw on.
        run: trajectory with an account of energy.
    """
    ticks = active_ticks(run)
    hours = drawable(ticks.time) / HOUR
    columns = [drawable(getattr(ticks.energy, name)) / 1e3 for name in _CONSUMERS]
    axis.stackplot(hours, columns, colors=list(_CONSUMERS.values()), lw=0.0)
    axis.set_ylabel("energy (kJ)")
    axis.set_xlabel("time (h)")
    if hours.size > 1:
        axis.set_xlim(0.0, float(hours[-1]))
    axis.set_ylim(bottom=0.0)
    handles = [
        Line2D([], [], color=colour, lw=5.0, label=f"{name} {column[-1]:.3g} kJ")
        for (name, colour), column in zip(_CONSUMERS.items(), columns, strict=True)
        if column.size and column[-1] > 0.0
    ]
    legend_above(axis, handles)
    return axis
