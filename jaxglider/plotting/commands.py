"""Figure of the commands, wanted and applied."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from jaxglider.plotting.lines import UNITS, draw_runs, run_handles
from jaxglider.plotting.series import active_ticks, curve, drawable, end_time
from jaxglider.plotting.style import FAINT, INK, flat, label_time, legend_above, styles
from jaxglider.signals import Command
from jaxglider.simulation.rollout import Trajectory
from jaxglider.vehicle.actuators import Actuator

_BEYOND = 1.15
"""Range of the axes in saturation limits."""
_SPARSE = (0, (1, 1.5))
_COMMANDS = {
    "buoyancy_mass": "buoyancy mass\n$m_b$ (kg)",
    "mass_position": "mass position\n$r_{p1}$ (m)",
    "mass_angle": "mass angle\nγ (deg)",
}


def commands(
    axes: Any, runs: Mapping[str, Trajectory], actuators: Command[Actuator]
) -> Any:
    """Commands of the controller (thin, pale) and of the actuators (solid).

    The axes end a little beyond the saturation limits, whatever was asked for.

    Args:
        axes: three axes, for buoyancy mass, position and angle of the moving mass.
        runs: label to trajectory.
        actuators: actuators of the scenario; their limits are drawn.
    """
    panels = flat(axes, 3, "commands")
    ticks = {label: active_ticks(run) for label, run in runs.items()}
    look = styles(runs)
    for axis, (name, title) in zip(panels, _COMMANDS.items(), strict=True):
        unit = UNITS[name]
        limit = float(unit(getattr(actuators, name).limit))
        for side in (-limit, limit):
            axis.axhline(side, color=INK, lw=0.8, ls=_SPARSE, zorder=1.5)
        for label, tick in ticks.items():
            wanted = np.clip(unit(getattr(tick.wanted, name)), -2 * limit, 2 * limit)
            curve(
                axis,
                drawable(tick.time),
                wanted,
                color=look[label].colour,
                lw=0.5,
                alpha=0.35,
                zorder=1.8,
            )
        lines = {
            label: (drawable(tick.time), unit(getattr(tick.applied, name)))
            for label, tick in ticks.items()
        }
        draw_runs(axis, lines, look)
        axis.set_ylim(-_BEYOND * limit, _BEYOND * limit)
        axis.set_yticks([-limit, -limit / 2, 0.0, limit / 2, limit])
        axis.set_ylabel(title)
    label_time(panels, end_time(runs.values()))
    saturation = Line2D([], [], color=INK, lw=0.8, ls=_SPARSE, label="saturation")
    wanted = Line2D([], [], color=FAINT, lw=0.6, label="wanted")
    legend_above(panels[0], [*run_handles(look), wanted, saturation])
    return axes
