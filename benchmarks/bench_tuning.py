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
from search_runs import CMA, DESCENT, LOOKS, RANDOM, Run, draw, summary, table

from jaxglider import map_members, paper
from jaxglider.files.writing import provenance
from tuning.cli.parser import parser as tune_parser
from tuning.problem.lanes import member_count
from tuning.problem.problem import TuningProblem, build_task
from tuning.reporting.statistics import plain
from tuning.search.descent import Descent, scattered
from tuning.search.evolution import cma_es, default_population, random_search
from tuning.search.rescue import is_lost, promising_gains
from tuning.search.settings import DescentSettings


@dataclasses.dataclass(frozen=True)
class Problem:
    """What is tuned, from where, and the problem in words."""

    task: TuningProblem
    start: Any
    about: str

    @property
    def member_count(self) -> int:
        """Number of members."""
        return member_count(self.task.training)


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
        task,
        task.space.read(task.loop),
        f"{options.scenario} on {options.plant}, objective of `jaxglider tune`",
    )


def make_losses(problem: Problem) -> Callable[[Any], Any]:
    """The compiled losses of a batch of free numbers, members as further lanes."""

    @jax.jit
    def losses(frees: Any) -> Any:
        count = frees.shape[0]
        lanes = (
            jnp.repeat(frees, problem.size, axis=0),
            jax.tree.map(
                lambda x: jnp.tile(x, (count,) + (1,) * (x.ndim - 1)),
                problem.task.training,
            ),
        )
        costs = map_members(lambda lane: problem.task.loss(*lane), lanes)
        table = costs.reshape(count, problem.size)
        return jax.vmap(lambda row: problem.task.aggregate(row)[0])(table)

    return losses


def run_descent(descent: Descent, problem: Problem, seed: int) -> Run:
    """Descend to the end of the steps, from a start that is found first if need be."""
    seeded = copy.copy(descent)
    seeded.settings = dataclasses.replace(descent.settings, seed=seed)
    cost = descent.settings.gradient_cost(problem.size, problem.task.aggregate)
    run, begun = Run(), time.perf_counter()
    state = seeded.start(problem.start)
    spent = cost
    first = float(state.loss[0])
    run.note(spent, time.perf_counter() - begun, first, problem.start)
    if is_lost(state.loss, problem.task.unit):
        found = promising_gains(problem.task, problem.start, first, seed)
        state = seeded.start(found.free)
        spent += found.rollouts + cost
        now = float(state.loss[0])
        run.note(spent, time.perf_counter() - begun, now, found.free)
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
    population = options.population or default_population(problem.start.size)
    losses = make_losses(problem)
    descent = Descent(
        problem.task.loss,
        problem.task.training,
        jax.tree.map(lambda x: x[:1], problem.task.training),
        DescentSettings(
            steps=options.steps, patience=options.steps, copies=options.copies
        ),
        problem.task.aggregate,
        guide=problem.task.guide,
        unit=problem.task.unit,
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
        names=problem.task.space.names,
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
        f"{problem.about}; {problem.size} members, {problem.start.size} numbers"
    )
    print(table(result, options.seeds))


if __name__ == "__main__":
    main()
