"""Work that the actuators do against gravity and pressure, for `tuned_gains.py`."""

from typing import Any

import jax
import numpy as np

from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import simulate

run = jax.jit(simulate)


def actuator_work(loop: ClosedLoop) -> tuple[float, float]:
    """Work of pump and moving mass on the nominal glider in the nominal sea [J].

    The pump pushes Δm_b out against the pressure, g Z |Δm_b| at depth Z. The mass is
    lifted by its own two moves, at the attitude that the hull has. What comes back on
    the way down is not counted: no pump and no motor gives it back.

    Args:
        loop: closed loop, not batched.
    """
    ticks = run(loop, loop.scenario.sea(jax.random.key(0))).ticks
    glider = loop.scenario.plant.parameters
    gravity, held = float(glider.gravity), ticks.applied
    mass = np.asarray(held.buoyancy_mass)
    pushed = np.maximum(-np.diff(mass, prepend=0.0), 0.0)
    pumped = float(
        np.sum(gravity * np.maximum(np.asarray(ticks.state.depth), 0.0) * pushed)
    )
    return pumped, float(glider.moving_mass) * gravity * _raised(ticks, glider)


def _raised(ticks: Any, glider: Any) -> float:
    """Height that the mass is raised by its own moves, all ticks together [m]."""
    angle = np.asarray(ticks.applied.mass_angle)
    arm = float(glider.mass_offset)
    place = np.stack(
        [
            np.asarray(ticks.applied.mass_position),
            arm * np.sin(angle),
            arm * np.cos(angle),
        ]
    )
    pitch, roll = np.asarray(ticks.state.pitch), np.asarray(ticks.state.roll)
    down = np.stack(
        [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)]
    )
    lowered = np.sum(down[:, 1:] * np.diff(place), axis=0)
    return float(np.sum(np.maximum(-lowered, 0.0)))
