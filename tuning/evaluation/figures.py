"""Figures of tuning: the objective, the gains that moved, the errors left."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jaxglider.plotting import errors
from jaxglider.plotting.lines import plain_numbers
from jaxglider.plotting.style import (
    COLUMN,
    INK,
    distinct_styles,
    legend_above,
    look,
    new_figure,
)
from jaxglider.simulation.rollout import Trajectory
from tuning.problem.problem import TuningProblem
from tuning.search.settings import Step

_MOST = 8
"""Gains that one figure can tell apart."""
_SETTLED = 1e-300
"""Least size of a ratio whose logarithm is taken."""


def tuning_figures(
    title: str,
    history: Sequence[Step],
    gains: Mapping[str, Sequence[float]],
    runs: Mapping[str, Trajectory],
) -> Iterator[tuple[str, Figure]]:
    """Name and figure, one at a time.

    Args:
        title: case, vehicle, plant and law.
        history: steps of the search.
        gains: value of each gain at each step, by its name.
        runs: nominal runs `before` and `after`, on the host.
    """
    with look():
        figure = new_figure(COLUMN, 2.6)
        draw_objective(figure.subplots(), history)
        figure.suptitle(title, wrap=True)
    yield "objective", figure
    with look():
        figure = new_figure(COLUMN, 4.0)
        axes = figure.subplots()
        draw_gains(axes, history, gains)
        legend_above(axes, axes.get_legend_handles_labels()[0])
        figure.suptitle(title, wrap=True)
    yield "gains", figure
    with look():
        figure = new_figure(COLUMN, 4.6)
        errors(figure.subplots(3, sharex=True), runs)
        figure.align_ylabels()
        figure.suptitle(title, wrap=True)
    yield "errors", figure


def draw_objective(axes: Axes, history: Sequence[Step]) -> Axes:
    """Objective on training and validation members step by step.

    Args:
        axes: axes to draw on.
        history: steps of the search.
    """
    steps = [s for s in history if not s.refused]
    refused = [s for s in history if s.refused]
    numbers = [s.number for s in steps]
    lines = {
        "training": [s.loss for s in steps],
        "validation": [s.validation for s in steps],
    }
    for (name, values), style in zip(lines.items(), distinct_styles(2), strict=True):
        axes.plot(numbers, values, color=style.colour, ls=style.dashes, label=name)
    top = max(np.nanmax(values) for values in lines.values())
    if refused:
        axes.plot(
            [s.number for s in refused],
            [min(s.loss, top) if np.isfinite(s.loss) else top for s in refused],
            "x",
            color=INK,
            ms=4.0,
            label="refused",
        )
    axes.set(xlabel="step", ylabel="objective", ylim=(0, 1.05 * top))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_above(axes, axes.get_legend_handles_labels()[0])
    return axes


def gains_of(problem: TuningProblem, history: Sequence[Step]) -> dict[str, list[float]]:
    """Value of each gain at each step, by its name.

    Args:
        problem: problem that was solved.
        history: steps of the search.
    """
    space = problem.space
    rows = [space.values(space.write(problem.loop, step.free)) for step in history]
    return {name: [float(row[name]) for row in rows] for name in space.names}


def draw_gains(
    axes: Axes, history: Sequence[Step], gains: Mapping[str, Sequence[float]]
) -> Axes:
    """The eight gains that moved most, over their start.

    Args:
        axes: axes to draw on; without a legend.
        history: steps of the search.
        gains: value of each gain at each step, by its name.
    """
    kept = [n for n, step in enumerate(history) if not step.refused]
    values = np.array(list(gains.values())).T[kept]
    ratios = values / values[0]
    prefixes = "controller.", "scenario.reference."
    names = [_without(name, prefixes) for name in gains]
    moved = np.abs(np.log(np.abs(ratios[-1]) + _SETTLED))
    chosen = sorted(np.argsort(-moved)[:_MOST])
    for column, style in zip(chosen, distinct_styles(len(chosen)), strict=True):
        axes.semilogy(
            [history[n].number for n in kept],
            ratios[:, column],
            color=style.colour,
            ls=style.dashes,
            label=names[column],
        )
    plain_numbers(axes.yaxis)
    some = "" if len(names) <= _MOST else f"\n({_MOST} of {len(names)}, moved most)"
    axes.set(xlabel="step", ylabel=f"gain over its start{some}")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return axes


def _without(name: str, prefixes: tuple[str, ...]) -> str:
    for prefix in prefixes:
        name = name.removeprefix(prefix)
    return name
