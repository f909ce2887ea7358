"""Figure of a record: depth, attitude, actuators and water over time."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxglider.plotting.style import (
    PAGE,
    distinct_styles,
    legend_above,
    look,
    new_figure,
)
from tuning.identification.record.flight_record import FlightRecord

_PANELS: tuple[tuple[str, tuple[str, ...], float], ...] = (
    ("depth (m)", ("depth", "pressure"), 1.0),
    ("attitude (deg)", ("pitch", "roll"), 180.0 / np.pi),
    ("ballast (cm³)", ("ballast",), 1e6),
    ("moving mass (mm)", ("mass_position",), 1e3),
    ("speed (m/s)", ("speed",), 1.0),
    ("density (kg/m³)", ("density",), 1.0),
)
_MOST = 4000


def record_figure(record: FlightRecord) -> Figure:
    """The figure of a record.

    Args:
        record: record to draw; channels it lacks have no panel.
    """
    panels = [p for p in _PANELS if any(record.has(name) for name in p[1])]
    begin, _ = record.span()
    with look():
        figure = new_figure(PAGE, 0.6 + 1.15 * len(panels))
        axes = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
        for axis, (label, names, factor) in zip(axes, panels, strict=True):
            axis.set_ylabel(label)
            _panel(axis, record, names, factor, begin)
        axes[-1].set_xlabel("time (h)")
        figure.align_ylabels()
        figure.suptitle(f"{record.name}, {record.kind}", wrap=True)
    return figure


def _panel(
    axis: Axes,
    record: FlightRecord,
    names: tuple[str, ...],
    factor: float,
    begin: float,
) -> None:
    drawn = [name for name in names if record.has(name)]
    if names[0] == "depth":
        drawn = drawn[:1]
    for name, style in zip(drawn, distinct_styles(len(drawn)), strict=True):
        series = record.channels[name]
        every = max(len(series) // _MOST, 1)
        scale = 1.0 / 1.0e4 if name == "pressure" else factor
        axis.plot(
            (series.time[::every] - begin) / 3600.0,
            scale * series.values[::every],
            ".",
            ms=1.2,
            color=style.colour,
            label=name,
        )
    if names[0] == "depth":
        axis.invert_yaxis()
        axis.set_ylabel("depth (m)" if drawn == ["depth"] else "pressure (dbar)")
    elif len(drawn) > 1:
        legend_above(axis, axis.get_legend_handles_labels()[0])
