"""Descent against black-box search: `python benchmarks/bench_tuning.py --out FILE.png`.

The problem is that of `jaxglider tune`, with its objective, members and free numbers.
All methods start from the same gains, and the loss shown is always that of the gains
themselves, on all members. Rollouts are counted as the work they stand for: a loss is
one rollout for each member, a gradient five for each of its lanes. Descent is charged,
besides its gradients, for the loss that judges each step.

Compilation is apart from the seconds. Wall times of a shared machine mean little;
rollouts do not depend on it.
"""

import argparse
import copy
import dataclasses
import json
import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jaxglider

jaxglider.enable_fast_loops()

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxglider import map_members, paper
from jaxglider.io import provenance, replacing
from tuning.derivative_free import (
    cma_es,
    default_population,
    random_search,
)
from tuning.descent import Descent
from tuning.descent_state import Settings
from tuning.objective import Aggregate, scattered
from tuning.options import parser as tune_parser
from tuning.task import build_task

DESCENT, CMA, RANDOM = "descent", "CMA-ES", "random"
LOOKS = {DESCENT: ("#0072B2", "-"), CMA: ("#D55E00", "--"), RANDOM: ("#009E73", ":")}
SLACKS = (1.0, 1.01, 1.05, 1.2)


@dataclasses.dataclass(frozen=True)
class Problem:
    """What is tuned: `loss(free, member)`, the members, and the free numbers to start.

    Attributes:
        loss: objective of free numbers and one member; pure.
        guide: what is differentiated instead, of the same values.
        members: pytree with one leading axis.
        aggregate: of the members' objectives.
        start: free numbers.
        names: of the numbers tuned.
        about: the problem in words.
    """

    loss: Callable[[Any, Any], Any]
    guide: Callable[[Any, Any], Any]
    members: Any
    aggregate: Aggregate
    start: Any
    names: tuple[str, ...]
    about: str

    @property
    def size(self) -> int:
        """Number of members."""
        return int(jax.tree.leaves(self.members)[0].shape[0])


def make_problem(options: argparse.Namespace) -> Problem:
    """The problem that `jaxglider tune` would set itself with these options."""
    words = [
        *("tune", "--scenario", options.scenario, "--plant", options.plant),
        *("--members", str(options.members), "--validation", "1", "--test", "1"),
    ]
    if options.duration is not None:
        words += ["--duration", str(options.duration)]
    if options.paths:
        words += ["--free", *options.paths]
    task = build_task(tune_parser().parse_args(words))
    return Problem(
        task.loss,
        task.guide,
        task.training,
        task.aggregate,
        task.space.read(task.loop),
        task.space.names,
        f"{options.scenario} on {options.plant}, objective of `jaxglider tune`",
    )


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


def make_losses(problem: Problem) -> Callable[[Any], Any]:
    """The compiled losses of a batch of free numbers, members as further lanes."""

    @jax.jit
    def losses(frees: Any) -> Any:
        count = frees.shape[0]
        lanes = (
            jnp.repeat(frees, problem.size, axis=0),
            jax.tree.map(
                lambda x: jnp.tile(x, (count,) + (1,) * (x.ndim - 1)), problem.members
            ),
        )
        costs = map_members(lambda lane: problem.loss(*lane), lanes)
        table = costs.reshape(count, problem.size)
        return jax.vmap(lambda row: problem.aggregate(row)[0])(table)

    return losses


def run_descent(descent: Descent, problem: Problem, seed: int) -> Run:
    """Descend to the end of the steps."""
    seeded = copy.copy(descent)
    seeded.settings = dataclasses.replace(descent.settings, seed=seed)
    cost = descent.settings.gradient_cost(problem.size, problem.aggregate)
    run, begun = Run(), time.perf_counter()
    state = seeded.start(problem.start)
    spent = cost
    first = float(state.loss[0])
    run.note(spent, time.perf_counter() - begun, first, problem.start)
    for _, step in seeded.run(state):
        spent += cost
        loss = step.loss if math.isfinite(step.loss) else math.inf
        run.note(spent, time.perf_counter() - begun, loss, step.free)
    return run


def run_search(steps: Iterator[Any]) -> Run:
    """Search until the budget is spent."""
    run, begun = Run(), time.perf_counter()
    for step in steps:
        run.note(step.rollouts, time.perf_counter() - begun, step.loss, step.free)
    return run


def compare(problem: Problem, options: argparse.Namespace) -> tuple[Any, Any]:
    """All runs by method, and the seconds to compile."""
    population = options.population or default_population(len(problem.names))
    losses = make_losses(problem)
    descent = Descent(
        problem.loss,
        problem.members,
        jax.tree.map(lambda x: x[:1], problem.members),
        Settings(steps=options.steps, patience=options.steps, copies=options.copies),
        problem.aggregate,
        guide=problem.guide,
    )

    def search(method: Any, spread: float, seed: int) -> Iterator[Any]:
        return method(
            losses,
            problem.start,
            options.budget,
            population,
            spread,
            seed,
            members=problem.size,
        )

    compile_s = {
        DESCENT: seconds(lambda: descent.advance(descent.start(problem.start))),
        CMA: seconds(lambda: losses(jnp.tile(problem.start, (population, 1)))),
    }
    compile_s[RANDOM] = compile_s[CMA]
    next(search(cma_es, options.cma_spread, 0))
    every: dict[str, Callable[[int], Run]] = {
        DESCENT: lambda seed: run_descent(descent, problem, seed),
        CMA: lambda seed: run_search(search(cma_es, options.cma_spread, seed)),
        RANDOM: lambda seed: run_search(
            search(random_search, options.random_spread, seed)
        ),
    }
    methods = {name: every[name] for name in options.methods}
    runs: dict[str, list[Run]] = {name: [] for name in methods}
    for seed in range(options.seeds):
        for name, method in methods.items():
            run = method(seed)
            run.around = loss_around(losses, run.free, population)
            runs[name].append(run)
            print(
                f"seed {seed}  {name:8} best {run.best[-1]:.4f}  "
                f"{run.rollouts[-1]} rollouts  {run.seconds[-1]:.1f} s",
                file=sys.stderr,
            )
    return runs, compile_s


def seconds(function: Callable[[], Any]) -> float:
    """Seconds of one call."""
    begun = time.perf_counter()
    jax.block_until_ready(function())
    return time.perf_counter() - begun


def loss_around(losses: Any, free: Any, batch: int, batches: int = 4) -> float:
    """Mean loss of copies scattered by 5 percent: what is left of a lucky best.

    Infinite where one of the copies fails: the gains are at an edge of stability.
    """
    copies = scattered(free, jax.random.key(99), batch * batches, 0.05)
    mean = float(np.mean([losses(rows) for rows in jnp.split(copies, batches)]))
    return mean if math.isfinite(mean) else math.inf


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


def plain(value: float) -> float | None:
    """The number, or None where JSON has none for it."""
    return float(value) if math.isfinite(value) else None


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


def main() -> None:
    """Compare and print a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", choices=paper.SCENARIOS, default="switching")
    parser.add_argument("--plant", choices=tuple(paper.PLANTS), default="rigid-body")
    parser.add_argument("--paths", nargs="+", help="numbers to tune; default: all")
    parser.add_argument("--members", type=int, default=32, help="1: the nominal case")
    parser.add_argument("--duration", type=float)
    parser.add_argument("--precision", type=int, choices=(32, 64), default=32)
    parser.add_argument("--steps", type=int, default=200, help="of the descent")
    parser.add_argument(
        "--budget", type=int, default=100_000, help="rollouts of each search"
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--methods", nargs="+", choices=tuple(LOOKS), default=[DESCENT, CMA, RANDOM]
    )
    parser.add_argument("--population", type=int, default=None)
    parser.add_argument("--cma-spread", type=float, default=0.5)
    parser.add_argument("--random-spread", type=float, default=1.0)
    parser.add_argument("--copies", type=int, default=8, help="lanes of a gradient")
    parser.add_argument("--out", type=Path, default=None, help="picture to draw")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", options.precision == 64)
    problem = make_problem(options)
    runs, compile_s = compare(problem, options)
    result = summary(runs, compile_s)
    about = provenance(
        problem=problem.about,
        names=problem.names,
        members=problem.size,
        settings={k: v for k, v in vars(options).items() if k not in ("out", "json")},
    )
    if options.out is not None:
        draw(runs, problem.about, options.out)
    if options.json:
        curves = {
            name: [
                {
                    "rollouts": run.rollouts,
                    "seconds": run.seconds,
                    "best": [plain(b) for b in run.best],
                    "free": np.asarray(run.free).tolist(),
                }
                for run in group
            ]
            for name, group in runs.items()
        }
        report = {**result, "curves": curves, "provenance": about}
        print(json.dumps(report, indent=2, allow_nan=False))
        return
    machine = about["hardware"]
    print(
        f"{machine['processor']}, {machine['cores']} cores, float{options.precision}; "
        f"{problem.about}; {problem.size} members, {len(problem.names)} numbers"
    )
    print(table(result, options.seeds))


if __name__ == "__main__":
    main()
