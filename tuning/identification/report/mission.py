"""The record's water, and a mission that flies the fitted vehicle through it."""

import json

import numpy as np

from tuning.identification.fitting import Fit
from tuning.identification.record.seawater import GRAVITY
from tuning.identification.record.uniform import Flight

LONGEST = 800.0
"""Longest dive of the mission [s]."""
LEVELS = 60
"""Largest number of depths of the density profile."""


def water_csv(flight: Flight) -> str:
    """Density over depth as the record has it, dives and climbs together, as CSV.

    The mean of the samples in each of some layers, at their mean depth.

    Args:
        flight: the record.
    """
    depth, density = flight.depth[flight.good], flight.density[flight.good]
    count = int(np.clip(np.ptp(depth), 2, LEVELS))
    edges = np.linspace(depth.min(), depth.max(), count + 1)
    layer = np.clip(np.digitize(depth, edges) - 1, 0, count - 1)
    rows = [
        f"{np.mean(depth[layer == n]):.2f},{np.mean(density[layer == n]):.4f}"
        for n in range(count)
        if np.any(layer == n)
    ]
    return "\n".join(["depth_m,density_kg_m3", *rows]) + "\n"


def mission_toml(fit: Fit, name: str) -> str:
    """A mission that flies the fitted vehicle as it was flown, in the record's water.

    A dive at the glide angle of the record through the density that it met, no deeper
    than it went. The depth rate is three fifths of the record's: pilots use all of
    their pump, and a law needs some of it to steer by.

    Args:
        fit: the fit.
        name: name of the vehicle.
    """
    flight = fit.flight
    steady, rate = flight.steady, np.abs(flight.depth_rate)
    depth = flight.depth[flight.good]
    density = float(np.mean(flight.density[flight.good]))
    pitch = np.degrees(np.abs(np.asarray(fit.after.true_pitch(flight.pitch[steady]))))
    glide = float(np.clip(np.median(pitch) + 3.0, 15.0, 60.0))
    shallow = float(np.percentile(depth, 5))
    squeezed = float(fit.after.record.compressibility) * density * GRAVITY
    sinking = 0.6 * float(np.median(rate[steady]))
    room = max(float(np.percentile(depth, 99)) - shallow - 2.0, 5.0)
    half = min(room / sinking, LONGEST) / 2.0
    return f"""# {name} in the water of its record.
# Fly it: jaxglider simulate --config mission.toml
name = {json.dumps(name, ensure_ascii=False)}

[clock]
dt_s = 0.1
duration_s = {2.0 * half:.0f}.0

[vehicle]
data = "vehicle.toml"
plant = "rigid-body"
design_factor = 1.0

[initial_state]
depth_m = {shallow:.1f}
surge_m_s = 0.1

[water.stratification]
file = "water.csv"
hull_compressibility_1_m = {squeezed:.4g}
neutral_depth_m = {float(np.median(depth)):.1f}

[reference]
type = "schedule"

[reference.schedule]
start_s = [0.0, {half:.0f}.0]
gliding_angle_deg = [{-glide:.1f}, {-glide:.1f}]
heading_deg = [0.0, 0.0]
depth_rate_m_s = {sinking:.3f}
initial_depth_m = {shallow:.1f}

[controller]
type = "fxtppc"

[observer]
type = "fixed-time"
"""
