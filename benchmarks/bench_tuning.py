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
from tuning.problem.lanes import member_count, scattered
from tuning.problem.problem import TuningProblem
from tuning.problem.spec import EnsembleSpec, ProblemSpec
from tuning.reporting.statistics import plain
from tuning.search.descent import Descent
from tuning.search.evolution import cma_es, default_population, random_search
from tuning.search.rescue import is_lost, promising_gains
from tuning.search.settings import DescentSettings


def make_problem(options: argparse.Namespace) -> TuningProblem:
    """The problem that `jaxglider tune` would set itself with these options."""
    spec = ProblemSpec.of_paper(
        options.scenario,
        options.plant,
        "fxtppc" if options.plant == "printed" else "fxtppc-roll",
        duration=options.duration,
        free=tuple(options.paths or ()),
        ensemble=EnsembleSpec(training=options.members, validation=1, test=1),
    )
    return TuningProblem.of(spec)


def start_of(problem: TuningProblem) -> Any:
    """The free numbers that every method starts from."""
    return problem.space.read(problem.loop)


def about(problem: TuningProblem) -> str:
    """The problem in words."""
    case = problem.spec.case
    return f"{case.title} on {case.plant}, objective of `jaxglider tune`"


def make_losses(problem: TuningProblem) -> Callable[[Any], Any]:
    """The compiled losses of a batch of free numbers, members as further lanes."""

    @jax.jit
    def losses(frees: Any) -> Any:
        count = frees.shape[0]
        lanes = (
            jnp.repeat(frees, member_count(problem.training), axis=0),
            jax.tree.map(
                lambda x: jnp.tile(x, (count,) + (1,) * (x.ndim - 1)),
                problem.training,
            ),
        )
        costs = map_members(lambda lane: problem.loss(*lane), lanes)
        table = costs.reshape(count, member_count(problem.training))
        return jax.vmap(lambda row: problem.spec.aggregate(row)[0])(table)

    return losses


def run_descent(descent: Descent, problem: TuningProblem, seed: int) -> Run:
    """Descend to the end of the steps, from a start that is found first if need be."""
    seeded = copy.copy(descent)
    seeded.settings = dataclasses.replace(descent.settings, seed=seed)
    cost = descent.settings.gradient_cost(
        member_count(problem.training), problem.spec.aggregate
    )
    run, begun = Run(), time.perf_counter()
    state = seeded.start(start_of(problem))
    spent = cost
    first = float(state.current.loss[0])
    run.note(spent, time.perf_counter() - begun, first, start_of(problem))
    if is_lost(state.current.loss, problem.cost_scale):
        found = promising_gains(problem, start_of(problem), first, seed)
        state = seeded.start(found.free)
        spent += found.rollouts + cost
        now = float(state.current.loss[0])
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


def compare(problem: TuningProblem, options: argparse.Namespace) -> tuple[Any, Any]:
    """All runs by method, and the seconds to compile."""
    population = options.population or default_population(start_of(problem).size)
    losses = make_losses(problem)
    descent = Descent(
        problem.loss,
        problem.training,
        jax.tree.map(lambda x: x[:1], problem.training),
        DescentSettings(
            steps=options.steps, patience=options.steps, copies=options.copies
        ),
        problem.spec.aggregate,
        surrogate_loss=problem.surrogate_loss,
        cost_scale=problem.cost_scale,
    )

    def search(method: Any, spread: float, seed: int) -> Iterator[Any]:
        return method(
            losses,
            start_of(problem),
            options.budget,
            population,
            spread,
            seed,
            members=member_count(problem.training),
        )

    compile_s = {
        DESCENT: seconds(lambda: descent.advance(descent.start(start_of(problem)))),
        CMA: seconds(lambda: losses(jnp.tile(start_of(problem), (population, 1)))),
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
    made_by = provenance(
        problem=about(problem),
        names=problem.space.names,
        members=member_count(problem.training),
        settings={k: v for k, v in vars(options).items() if k not in ("out", "json")},
    )
    if options.out is not None:
        draw(runs, about(problem), options.out)
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
        report = {**result, "curves": curves, "provenance": made_by}
        print(json.dumps(report, indent=2, allow_nan=False))
        return
    machine = made_by["hardware"]
    print(
        f"{machine['processor']}, {machine['cores']} cores, float{options.precision}; "
        f"{about(problem)}; {member_count(problem.training)} members, "
        f"{start_of(problem).size} numbers"
    )
    print(table(result, options.seeds))


if __name__ == "__main__":
    main()
