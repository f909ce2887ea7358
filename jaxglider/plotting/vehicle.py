"""Figures of one run: the state sheet of the vehicle, the disturbance it estimated."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from jaxglider.plotting.series import (
    active_ticks,
    continuous_degrees,
    curve,
    degrees,
    drawable,
    end_time,
)
from jaxglider.plotting.style import (
    INK,
    flat,
    in_words,
    label_time,
    legend_above,
    off_scale,
)
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.tick import TickRecord

STATE_PANELS = 15
_BLUE = "#0072B2"
_BROAD, _THIN = 1.8, 0.7
"""Line widths: both are seen where one lies on the other."""
_AXES = {
    "surge": "surge (N)",
    "sway": "sway (N)",
    "heave": "heave (N)",
    "roll": "roll (N m)",
    "pitch": "pitch (N m)",
    "yaw": "yaw (N m)",
}


def disturbance_estimate(
    axes: Any, run: Trajectory, label: str = "", colour: str = _BLUE
) -> Any:
    """The observer's estimate against what the design model left unexplained.

    The truth is a thin line over the broad one of the estimate.

    Args:
        axes: six axes, for surge, sway, heave, roll, pitch and yaw.
        run: run of one controller.
        label: label of the controller, for the legend.
        colour: colour of the estimate.
    """
    panels = flat(axes, len(_AXES), "disturbance_estimate")
    ticks = active_ticks(run)
    time = drawable(ticks.time)
    for axis, (name, title) in zip(panels, _AXES.items(), strict=True):
        truth = drawable(getattr(ticks.lumped, name))
        estimate = drawable(getattr(ticks.estimate, name))
        curve(axis, time, estimate, color=colour, lw=_BROAD)
        curve(axis, time, truth, color=INK, lw=_THIN, zorder=3)
        axis.set_ylabel(title)
        _look_at_most(axis, np.concatenate([truth, estimate]))
    label_time(panels, end_time([run]))
    entry = f"estimate ({label})" if label else "estimate"
    lumped = Line2D([], [], color=INK, lw=_THIN, label="lumped disturbance")
    handle = Line2D([], [], color=colour, lw=_BROAD, label=entry)
    legend_above(panels[1], [lumped], beside=panels[:3])
    legend_above(panels[2], [handle], beside=panels[:3])
    return axes


def vehicle_state(axes: Any, run: Trajectory, colour: str = _BLUE) -> Any:
    """The state sheet: position, attitude, velocity, rates, and the flow.

    Args:
        axes: fifteen axes, five rows of three.
        run: run of one controller.
        colour: colour of the lines.
    """
    panels = flat(axes, STATE_PANELS, "vehicle_state")
    ticks = active_ticks(run)
    time = drawable(ticks.time)
    for axis, (title, values) in zip(panels, _sheet(ticks).items(), strict=True):
        curve(axis, time, values, color=colour, lw=0.9)
        axis.set_title(title)
    panels[2].invert_yaxis()
    label_time(panels, end_time([run]))
    return axes


def _sheet(ticks: TickRecord) -> dict[str, np.ndarray]:
    """Title and values of each panel."""
    s = ticks.state
    surge, sway, heave = drawable(s.surge), drawable(s.sway), drawable(s.heave)
    speed = np.sqrt(surge**2 + sway**2 + heave**2)
    with np.errstate(invalid="ignore", divide="ignore"):
        sideslip = np.arcsin(sway / speed)
    return {
        "north X (m)": drawable(s.north),
        "east Y (m)": drawable(s.east),
        "depth Z (m)": drawable(s.depth),
        "roll φ (deg)": degrees(s.roll),
        "pitch θ (deg)": degrees(s.pitch),
        "heading ψ (deg)": continuous_degrees(s.heading),
        "surge u (m/s)": surge,
        "sway v (m/s)": sway,
        "heave w (m/s)": heave,
        "roll rate p (deg/s)": degrees(s.roll_rate),
        "pitch rate q (deg/s)": degrees(s.pitch_rate),
        "yaw rate r (deg/s)": degrees(s.yaw_rate),
        "speed V (m/s)": speed,
        "angle of attack α (deg)": degrees(np.arctan2(heave, surge)),
        "sideslip β (deg)": degrees(sideslip),
    }


def _look_at_most(axis: Axes, values: np.ndarray) -> None:
    """Leave short peaks off the scale where they would flatten all the rest."""
    known = values[np.isfinite(values)]
    if not known.size:
        return
    low, high = np.percentile(known, [3.0, 97.0])
    margin = 0.6 * (high - low)
    least, most = float(known.min()), float(known.max())
    if margin > 0.0 and most - least > 3.0 * (high - low + 2.0 * margin):
        peaks = f"peaks {in_words(least)} to {in_words(most)}"
        off_scale(axis, low - margin, high + margin, peaks)
