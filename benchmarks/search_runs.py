"""Runs of several methods on one problem: their curves, figures and picture."""

import dataclasses
import math
import statistics
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from jaxglider.files.writing import replacing
from tuning.reporting.statistics import plain

DESCENT, CMA, RANDOM = "descent", "CMA-ES", "random"
LOOKS = {DESCENT: ("#0072B2", "-"), CMA: ("#D55E00", "--"), RANDOM: ("#009E73", ":")}
SLACKS = (1.0, 1.01, 1.05, 1.2)


@dataclasses.dataclass
class Run:
    """One method from one seed: what was spent, and the best loss, after each step."""

    rollouts: list[int] = dataclasses.field(default_factory=list)
    seconds: list[float] = dataclasses.field(default_factory=list)
    best: list[float] = dataclasses.field(default_factory=list)
    free: Any = None
    around: float = math.nan

    def note(self, rollouts: int, seconds: float, loss: float, free: Any) -> None:
        """Add a step."""
        lowest = self.best[-1] if self.best else math.inf
        if self.free is None or loss < lowest:
            lowest, self.free = loss, free
        self.rollouts.append(rollouts)
        self.seconds.append(seconds)
        self.best.append(lowest)

    def rollouts_to(self, level: float) -> float:
        """Rollouts spent when the best loss came to a level; infinite if it never did.

        The level may be off by the last bit of a product.
        """
        reached = np.flatnonzero(np.asarray(self.best) <= level * (1.0 + 1e-9))
        return float(self.rollouts[reached[0]]) if reached.size else math.inf


def summary(runs: dict[str, list[Run]], compile_s: dict[str, float]) -> dict[str, Any]:
    """Each method's end, and the rollouts that each needs to come to some levels."""
    ends = {
        name: {
            "best": spread_of([r.best[-1] for r in group]),
            "best_scattered": spread_of([r.around for r in group]),
            "rollouts": spread_of([r.rollouts[-1] for r in group]),
            "seconds": spread_of([r.seconds[-1] for r in group]),
            "compile_s": compile_s[name],
        }
        for name, group in runs.items()
    }
    wanted = [
        (f"{name}'s best x {s:g}", s * ends[name]["best"]["median"])
        for name, slacks in ((CMA, SLACKS), (DESCENT, SLACKS[:1]))
        for s in slacks
        if name in ends
    ]
    levels = []
    for title, level in wanted:
        needed = {n: [r.rollouts_to(level) for r in g] for n, g in runs.items()}
        middle = {n: statistics.median_high(v) for n, v in needed.items()}
        levels.append(
            {
                "title": title,
                "level": level,
                "rollouts": {n: plain(v) for n, v in middle.items()},
                "reached": {
                    n: sum(math.isfinite(x) for x in v) for n, v in needed.items()
                },
                "cma_over_descent": plain(
                    ratio(middle.get(CMA, math.inf), middle.get(DESCENT, math.inf))
                ),
            }
        )
    return {"methods": ends, "levels": levels}


def spread_of(values: list[Any]) -> dict[str, Any]:
    """Median and extremes."""
    return {
        "median": plain(statistics.median(values)),
        "min": plain(min(values)),
        "max": plain(max(values)),
    }


def ratio(above: float, below: float) -> float:
    """A quotient, not finite where either never got there."""
    return above / below if math.isfinite(above) and math.isfinite(below) else math.nan


def table(result: dict[str, Any], seeds: int) -> str:
    """The summary for a terminal: median over the seeds, and their range."""

    def cell(values: dict[str, Any]) -> str:
        middle, low, high = (
            "inf" if values[k] is None else figure(values[k])
            for k in ("median", "min", "max")
        )
        return f"{middle} [{low}, {high}]"

    titles = ("best loss", "scattered 5 %", "rollouts", "run s", "compile s")
    widths = (26, 26, 20, 22, 11)
    lines = [
        f"{'':10}" + "".join(f"{t:>{w}}" for t, w in zip(titles, widths, strict=True))
    ]
    for name, row in result["methods"].items():
        cells = [
            *(cell(row[k]) for k in ("best", "best_scattered", "rollouts", "seconds")),
            figure(row["compile_s"]),
        ]
        lines.append(
            f"{name:10}"
            + "".join(f"{c:>{w}}" for c, w in zip(cells, widths, strict=True))
        )
    names = tuple(result["methods"])
    lines += [
        "",
        f"rollouts until a loss is reached, median (seeds of {seeds} that reached it)",
        f"{'':24}{'loss':>10}"
        + "".join(f"{n:>16}" for n in names)
        + f"{'CMA-ES/descent':>18}",
    ]
    for row in result["levels"]:
        counts = (f"{figure(row['rollouts'][n])} ({row['reached'][n]})" for n in names)
        cells = "".join(f"{count:>16}" for count in counts)
        lines.append(
            f"{row['title']:24}{figure(row['level']):>10}{cells}"
            f"{figure(row['cma_over_descent']):>18}"
        )
    return "\n".join(lines)


def figure(value: float | None) -> str:
    """A number in a table; a dash where there is none."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.4g}"


def draw(runs: dict[str, list[Run]], title: str, path: Path) -> None:
    """Best loss so far against rollouts and seconds: median, and range over seeds."""
    matplotlib.rcdefaults()
    drawing = Figure(figsize=(7.2, 3.2), layout="constrained")
    axes = drawing.subplots(1, 2, sharey=True)
    for name, group in runs.items():
        colour, dashes = LOOKS[name]
        for panel, field in zip(axes, ("rollouts", "seconds"), strict=True):
            at, values = on_one_axis(group, field)
            panel.plot(
                at,
                np.median(values, axis=0),
                color=colour,
                linestyle=dashes,
                drawstyle="steps-post",
                label=name,
            )
            panel.fill_between(
                at,
                np.min(values, axis=0),
                np.max(values, axis=0),
                step="post",
                color=colour,
                alpha=0.15,
                linewidth=0,
            )
    for panel, label in zip(
        axes, ("rollouts (a gradient counts five)", "seconds, compiled"), strict=True
    ):
        panel.set_xscale("log")
        panel.set_xlabel(label)
        panel.grid(alpha=0.3)
    axes[0].set_ylabel("best loss so far")
    axes[0].legend(frameon=False)
    drawing.suptitle(title, fontsize=9)
    with replacing(path) as temporary:
        drawing.savefig(temporary, dpi=200)


def on_one_axis(group: list[Run], field: str) -> tuple[np.ndarray, np.ndarray]:
    """Best losses of all seeds where all have begun, at every point of any of them."""
    points = [np.asarray(getattr(run, field), float) for run in group]
    begun = max(p[0] for p in points)
    at = np.unique(np.concatenate(points))
    at = at[at >= begun]
    rows = [
        np.asarray(run.best)[np.searchsorted(p, at, side="right") - 1]
        for run, p in zip(group, points, strict=True)
    ]
    return at, np.stack(rows)
