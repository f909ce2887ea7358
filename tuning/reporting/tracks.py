"""Tracks that a reader can zoom into, in a page that loads nothing; by plotly."""

import importlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxglider.plotting.series import (
    active_ticks,
    continuous_degrees,
    degrees,
    drawable,
    end_time,
    keep_extremes,
)
from jaxglider.plotting.style import styles, time_unit
from jaxglider.simulation.rollout import Trajectory

_ROWS = ("depth (m)", "pitch (deg)", "heading (deg)")


def check_plotly() -> None:
    """Refuse tracks that cannot be drawn here, before the work.

    Raises:
        ValueError: plotly is not installed.
    """
    _plotly()


def interactive_tracks(runs: Mapping[str, Trajectory], title: str) -> str:
    """The way from above beside depth, pitch and heading over time, as HTML.

    A pointer shows time and place, a click on a label hides a run, a drag zooms. The
    program for that, some 5 MB, stands in the page.

    Args:
        runs: label to trajectory, on the host.
        title: case, vehicle and plant.

    Raises:
        ValueError: plotly is not installed.
    """
    figure = _plotly()(
        rows=3,
        cols=2,
        specs=[[{"rowspan": 3}, {}], [None, {}], [None, {}]],
        horizontal_spacing=0.1,
        vertical_spacing=0.05,
    )
    unit, name = time_unit(end_time(runs.values()))
    for label, style in styles(runs).items():
        for row, column, line in _lines(runs[label], unit):
            figure.add_scatter(
                **line,
                mode="lines",
                name=label,
                legendgroup=label,
                showlegend=(row, column) == (1, 1),
                line={"color": style.colour, "width": 1.5},
                row=row,
                col=column,
            )
    _arrange(figure, title, name)
    return str(
        figure.to_html(
            full_html=False, include_plotlyjs=True, config={"displaylogo": False}
        )
    )


def _arrange(figure: Any, title: str, time: str) -> None:
    """Names and scales of the axes: one scale for the map, one time, depth downward."""
    figure.update_layout(
        title=title, template="simple_white", height=620, margin={"l": 60, "r": 20}
    )
    figure.update_xaxes(title_text="east Y (m)", row=1, col=1)
    figure.update_yaxes(
        title_text="north X (m)", scaleanchor="x", scaleratio=1, row=1, col=1
    )
    for row, name in enumerate(_ROWS, 1):
        figure.update_yaxes(title_text=name, row=row, col=2)
        figure.update_xaxes(matches="x2", showticklabels=row == 3, row=row, col=2)
    figure.update_yaxes(autorange="reversed", row=1, col=2)
    figure.update_xaxes(title_text=time, row=3, col=2)


def _lines(run: Trajectory, unit: float) -> list[tuple[int, int, dict[str, Any]]]:
    """Row, column and numbers of each line of a run; few points, extremes kept.

    Args:
        run: a run.
        unit: unit of the time axis [s].
    """
    ticks = active_ticks(run)
    time, state = drawable(ticks.time), ticks.state
    north, east, depth = (drawable(x) for x in (state.north, state.east, state.depth))
    seen = keep_extremes(north, east)
    place = {
        "x": _rounded(east[seen]),
        "y": _rounded(north[seen]),
        "customdata": np.stack([_rounded(time[seen]), _rounded(depth[seen])], axis=1),
        "hovertemplate": "%{customdata[0]} s: north %{y} m, east %{x} m, "
        "depth %{customdata[1]} m",
    }
    lines = [(1, 1, place)]
    angles = degrees(state.pitch), continuous_degrees(state.heading)
    for row, values in enumerate((depth, *angles), 1):
        kept = keep_extremes(values)
        lines.append(
            (row, 2, {"x": _rounded(time[kept] / unit), "y": _rounded(values[kept])})
        )
    return lines


def _rounded(values: np.ndarray) -> np.ndarray:
    """Numbers as far as a reader can see them."""
    return np.round(values, 3)


def _plotly() -> Any:
    """The function of plotly that makes figures of several panels."""
    try:
        return importlib.import_module("plotly.subplots").make_subplots
    except ImportError as error:
        raise ValueError(
            "--interactive needs the package plotly: `pip install plotly`, or leave "
            "the option out: the report has all figures as pictures."
        ) from error
