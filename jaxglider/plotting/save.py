"""All the figures of a comparison, made one after the other and written to files."""

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure

from jaxglider.control.prescribed.performance import (
    AbstractPerformanceFunction,
    ExponentialFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.guidance import WaypointPath
from jaxglider.guidance.routes import route_of
from jaxglider.plotting.commands import commands
from jaxglider.plotting.comparison import errors, tracking
from jaxglider.plotting.flight import energy, flight
from jaxglider.plotting.navigation import estimates, reckoned_map
from jaxglider.plotting.path import (
    depth_over_distance,
    on_the_map,
    path_3d,
    path_plan,
)
from jaxglider.plotting.performance import performance_functions, settling_time
from jaxglider.plotting.series import active_ticks
from jaxglider.plotting.style import COLUMN, PAGE, look, new_figure, styles
from jaxglider.plotting.vehicle import disturbance_estimate, vehicle_state
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.scenario import Scenario


def published_functions() -> dict[str, AbstractPerformanceFunction]:
    """The three published forms with the numbers of the paper's first depth funnel."""
    numbers = (1.0, 0.2, 100.0)
    return {
        "sech(sech(P₀) z), proposed": SechFunction(*numbers),
        "½ sech(P₀ z), PPC": HalfSechFunction(*numbers),
        "exponential, original": ExponentialFunction(*numbers),
    }


def figures(
    scenario: Scenario,
    runs: Mapping[str, Trajectory],
    functions: Mapping[str, AbstractPerformanceFunction] | None = None,
    title: str = "",
) -> Iterator[tuple[str, Figure]]:
    """Name and figure, one at a time, sized for a journal.

    Args:
        scenario: scenario of all the runs.
        runs: label to trajectory.
        functions: performance functions to compare; the published forms by default,
            no such figure if empty.
        title: name of what was flown, such as case and plant; stands above figures.
    """
    runs = {label: scenario.origin.on_the_map(run) for label, run in runs.items()}
    for name, build in _builders(scenario, runs, functions).items():
        with look():
            figure = build()
            _entitle(figure, title, runs if name != "performance_functions" else {})
        yield name, figure


def _entitle(figure: Figure, title: str, runs: Mapping[str, Trajectory]) -> None:
    """Put case, plant and law above a figure; several laws are told by its legend."""
    if not title or not runs:
        return
    law = figure.get_suptitle() or (next(iter(runs)) if len(runs) == 1 else "")
    figure.suptitle(f"{title}, {law}" if law else title, wrap=True)


def save_all(
    folder: str | os.PathLike[str],
    scenario: Scenario,
    runs: Mapping[str, Trajectory],
    formats: Sequence[str] = ("png",),
    functions: Mapping[str, AbstractPerformanceFunction] | None = None,
    title: str = "",
) -> list[Path]:
    """Write every figure; a file appears under its name only when it is complete.

    Args:
        folder: folder, made if it is not there.
        scenario: scenario of all the runs.
        runs: label to trajectory.
        formats: file endings that Matplotlib knows.
        functions: performance functions to compare; the published forms by default,
            no such figure if empty.
        title: name of what was flown, such as case and plant; stands above figures.

    Returns:
        The files written.
    """
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    written = []
    for name, figure in figures(scenario, runs, functions, title):
        for ending in formats:
            written.append(save(figure, place / f"{name}.{ending}"))
        figure.clear()
    return written


def save(figure: Figure, path: Path) -> Path:
    """Write one figure to a temporary name beside its own, then rename it.

    Args:
        figure: figure to write.
        path: path of the file; its ending is the format.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with look():
            figure.savefig(temporary, format=path.suffix.lstrip("."))
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def _builders(
    scenario: Scenario,
    runs: Mapping[str, Trajectory],
    functions: Mapping[str, AbstractPerformanceFunction] | None,
) -> dict[str, Callable[[], Figure]]:
    """Makers of the figures by their names."""
    reference = scenario.reference
    path = route_of(reference)
    if path is not None:
        path = on_the_map(path, scenario.origin)
    horizon = scenario.clock.ticks * float(scenario.clock.dt)
    shapes = published_functions() if functions is None else functions
    builders: dict[str, Callable[[], Figure]] = {}
    if shapes:
        builders["performance_functions"] = lambda: _performance(shapes, horizon)
    builders |= {
        "tracking": lambda: _stacked(lambda axes: tracking(axes, runs)),
        "errors": lambda: _stacked(lambda axes: errors(axes, runs)),
        "commands": lambda: _stacked(
            lambda axes: commands(axes, runs, scenario.actuators)
        ),
        "path_3d": lambda: _in_space(runs, path),
        "path_plan": lambda: _from_above(runs, path),
        "depth_over_distance": lambda: _along(runs),
    }
    for label, style in styles(runs).items():
        if not has_data(runs[label]):
            continue
        name = re.sub(r"[^a-z0-9]+", "_", label.lower()).strip("_") or "run"
        builders[_free(f"vehicle_state_{name}", builders)] = partial(
            _sheet, label, runs[label], style.colour
        )
        builders[_free(f"disturbance_estimate_{name}", builders)] = partial(
            _estimate, label, runs[label], style.colour
        )
        if runs[label].ticks.phase is not None:
            builders[_free(f"flight_{name}", builders)] = partial(
                _flight, label, runs[label], scenario
            )
        if scenario.energy is not None:
            builders[_free(f"energy_{name}", builders)] = partial(
                _energy, label, runs[label]
            )
        if runs[label].ticks.onboard is not None:
            builders[_free(f"reckoning_{name}", builders)] = partial(
                _reckoned, label, runs[label], path
            )
            builders[_free(f"estimates_{name}", builders)] = partial(
                _estimated, label, runs[label]
            )
    return builders


def has_data(run: Trajectory) -> bool:
    """Whether any active tick of a run has a finite state."""
    state = active_ticks(run).state
    fields = [np.isfinite(np.asarray(x)) for x in jax.tree.leaves(state)]
    return bool(np.logical_and.reduce(fields).any())


def _free(name: str, names: Mapping[str, object]) -> str:
    """The name, numbered where two labels differ only in what a file cannot show."""
    number, candidate = 2, name
    while candidate in names:
        number, candidate = number + 1, f"{name}_{number}"
    return candidate


def _stacked(draw: Callable[[np.ndarray], object]) -> Figure:
    """Three panels above each other in one journal column."""
    figure = new_figure(COLUMN, 4.6)
    draw(figure.subplots(3, 1, sharex=True))
    figure.align_ylabels()
    return figure


def _performance(
    functions: Mapping[str, AbstractPerformanceFunction], horizon: float
) -> Figure:
    figure = new_figure(COLUMN, 2.8)
    settled = [settling_time(function, horizon) for function in functions.values()]
    duration = min(1.2 * max(settled, default=horizon), horizon)
    performance_functions(figure.subplots(), functions, duration)
    figure.suptitle("performance functions", wrap=True)
    return figure


def _in_space(runs: Mapping[str, Trajectory], path: WaypointPath | None) -> Figure:
    figure = new_figure(COLUMN, 3.65)
    engine = figure.get_layout_engine()
    if engine is not None:
        # Names of axes in space count for nothing in a layout, and would be cut off.
        engine.set(rect=(0.0, 0.08, 1.0, 0.92))  # type: ignore[call-arg]
    path_3d(figure.add_subplot(projection="3d"), runs, path)
    return figure


def _from_above(runs: Mapping[str, Trajectory], path: WaypointPath | None) -> Figure:
    figure = new_figure(COLUMN, 4.0)
    path_plan(figure.subplots(), runs, path)
    return figure


def _estimate(label: str, run: Trajectory, colour: str) -> Figure:
    figure = new_figure(PAGE, 3.8)
    figure.suptitle(label, wrap=True)
    axes = figure.subplots(2, 3, sharex=True)
    disturbance_estimate(axes, run, label, colour)
    figure.align_ylabels()
    return figure


def _flight(label: str, run: Trajectory, scenario: Scenario) -> Figure:
    figure = new_figure(PAGE, 8.6)
    figure.suptitle(label, wrap=True)
    flight(figure.subplots(6, 1, sharex=True), run, scenario.actuators)
    figure.align_ylabels()
    return figure


def _along(runs: Mapping[str, Trajectory]) -> Figure:
    figure = new_figure(COLUMN, 2.4)
    depth_over_distance(figure.subplots(), runs)
    return figure


def _energy(label: str, run: Trajectory) -> Figure:
    figure = new_figure(COLUMN, 3.2)
    figure.suptitle(label, wrap=True)
    energy(figure.subplots(), run)
    return figure


def _reckoned(label: str, run: Trajectory, path: WaypointPath | None) -> Figure:
    figure = new_figure(COLUMN, 4.0)
    figure.suptitle(label, wrap=True)
    reckoned_map(figure.subplots(), run, path)
    return figure


def _estimated(label: str, run: Trajectory) -> Figure:
    figure = new_figure(PAGE, 6.4)
    figure.suptitle(label, wrap=True)
    estimates(figure.subplots(4, 1, sharex=True), run)
    figure.align_ylabels()
    return figure


def _sheet(label: str, run: Trajectory, colour: str) -> Figure:
    figure = new_figure(PAGE, 7.4)
    figure.suptitle(label, wrap=True)
    vehicle_state(figure.subplots(5, 3, sharex=True), run, colour)
    return figure
