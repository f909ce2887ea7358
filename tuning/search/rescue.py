"""A start for gains that cannot be descended from: the best that a short search finds.

Where many runs are lost, or turn where they should not, the gradients of these lead
nowhere, but a few hundred draws tell which way the gliders fly. Where all of them are
lost there is nothing to descend from, and the search says what it tried.
"""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Series
from jaxglider.simulation.checks.failure import explain
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import simulate
from tuning.problem.lanes import FAILED_COST, member_count
from tuning.problem.problem import TuningProblem
from tuning.reporting.console import Progress
from tuning.search.evolution import Generation, cma_es
from tuning.search.settings import Step

LOST_COST = 1.45
"""Objective from which a start is exchanged, in units of what a run like it costs on
the nominal case; the paper's gains, where all fly, come to 1.05."""
MOST_GENERATIONS, DRAWS_PER_GENERATION, SPREAD = 12, 64, 0.5
"""Largest number of generations of the search, draws of a generation, and spread of
the draws in the logarithm of a gain."""
PROMISING_COST = 1.25
"""Objective, in the same units, with which the search ends early: few runs, if any, are
lost."""

HOPELESS = 0.95
"""Share of the objective of gains that lose every glider, from which on gains count as
no better than these."""
MOST_HOPELESS = 4
"""Generations after which a search ends that has found no such gains."""
SHOWN = 3
"""Number of the best sets of gains that are told of a search that came to nothing."""


class CannotStart(FloatingPointError):
    """No gains that were tried keep the gliders: there is nothing to tune from.

    Attributes:
        tried: closed loops with the best gains that were tried, the best first.
    """

    def __init__(self, message: str, tried: Sequence[ClosedLoop] = ()) -> None:
        """Keep the gains beside the message.

        Args:
            message: account of what was tried, and why it fails.
            tried: closed loops with the best gains that were tried.
        """
        super().__init__(message)
        self.tried = tuple(tried)


class SearchResult(NamedTuple):
    """Result of the search.

    Attributes:
        free: free numbers that are best.
        rollouts: number of rollouts spent.
        remark: account of what was done, in words; empty if nothing had to be.
        tried: best sets of gains of a search that came to nothing, else none.
    """

    free: Series
    rollouts: int
    remark: str
    tried: tuple[Generation | Step, ...] = ()


def is_lost(objectives: Series, cost_scale: float) -> bool:
    """Whether no start is worth a descent, by the objective of each."""
    return bool(jnp.min(objectives) >= LOST_COST * cost_scale)


def promising_gains(
    problem: TuningProblem,
    free: Series,
    objective: float | None,
    seed: int,
    tell: Callable[[str], None] = lambda text: None,
    acceptable: Callable[[Series], bool] = lambda free: True,
) -> SearchResult:
    """Gains to descend from instead of gains with which members go astray.

    CMA-ES on the training members, until few of them do. Gains that are not acceptable
    do not end it, and are taken only where no others are better than those given.

    Args:
        problem: problem to solve.
        free: free numbers of the gains as given.
        objective: objective of these gains; None to find it.
        seed: seed of the draws.
        tell: function that is told how far the search is.
        acceptable: whether free numbers are fit to descend from, such as those of a
            stable loop: from an unstable one a descent hardly comes to a stable one.
    """
    run, scale = problem.losses_on(problem.training), problem.cost_scale
    members = member_count(problem.training)
    lost = HOPELESS * FAILED_COST * scale
    budget = (1 + DRAWS_PER_GENERATION * MOST_GENERATIONS) * members
    generations: list[Generation] = []
    # Each set of gains is looked at once at most.
    fit = functools.cache(lambda at: acceptable(generations[at].free))
    search = cma_es(
        run,
        free,
        budget,
        DRAWS_PER_GENERATION,
        SPREAD,
        seed,
        members=members,
        known=objective,
    )
    for step in search:
        generations.append(step)
        if step.number == 0 and not is_lost(jnp.asarray(step.loss), scale):
            return SearchResult(free, step.rollouts, "")
        tell(
            f"members go astray with the starting gains; searching: generation "
            f"{step.number}/{MOST_GENERATIONS}  objective {step.loss:.3g}"
        )
        best = min(generations, key=lambda one: one.loss)
        hopeless = step.number >= MOST_HOPELESS and not best.loss < lost
        promising = step.loss < PROMISING_COST * scale
        if hopeless or (promising and fit(len(generations) - 1)):
            break
    return _outcome(generations, lost, fit)


def _outcome(
    generations: list[Generation], lost: float, fit: Callable[[int], bool]
) -> SearchResult:
    """Outcome of a search: its best gains, or those given where none are better.

    Args:
        generations: the given gains, then each generation.
        lost: objective from which on gains count as no better than lost ones.
        fit: whether the gains of a generation are acceptable, by its place.
    """
    given, count = generations[0].loss, generations[-1].number
    spent = generations[-1].rollouts
    better = [at for at, x in enumerate(generations) if x.loss < min(given, lost)]
    if not better:
        hopeless = not given < lost
        return SearchResult(
            generations[0].free,
            spent,
            f"members go astray with the starting gains (objective {given:.3g}), and "
            f"with {DRAWS_PER_GENERATION * count} others around them"
            + ("" if hopeless else "; descending all the same."),
            tuple(sorted(generations[1:], key=lambda step: step.loss)[:SHOWN])
            if hopeless
            else (),
        )
    ranking = sorted(better, key=lambda at: generations[at].loss)
    best = generations[next(filter(fit, ranking), ranking[0])]
    return SearchResult(
        best.free,
        spent,
        f"members go astray with the starting gains (objective {given:.3g}): "
        f"descending from the best of a search of {count} "
        f"generation{'s' if count > 1 else ''} ({best.loss:.3g}).",
    )


def cannot_start(problem: TuningProblem, search: SearchResult) -> CannotStart:
    """The error of a search that came to nothing: why, and the best it tried.

    Args:
        problem: problem to solve.
        search: result of the search.
    """
    failed, why = FAILED_COST * problem.cost_scale, why_lost(problem)[0]
    loops = [problem.space.write(problem.loop, one.free) for one in search.tried]
    before = problem.space.values(problem.loop)
    lines = [
        f"nothing to tune from: {search.remark}; {why}",
        f"the best that was tried (where every glider is lost, it is {failed:.3g}):",
    ]
    for number, (one, loop) in enumerate(zip(search.tried, loops, strict=True), 1):
        after = problem.space.values(loop)
        moved = sorted(after, key=lambda name: -_change(before[name], after[name]))
        changes = ", ".join(
            f"{name} {before[name]:.3g} -> {after[name]:.3g}" for name in moved[:SHOWN]
        )
        lines.append(f"  {number}. objective {one.loss:.3g}: {changes}, ...")
    lines.append(
        "Start from gains that fly (--gains FILE), make the task easier, or shorten "
        "the tick; `jaxglider simulate` or `compare` shows one flight."
    )
    return CannotStart("\n".join(lines), loops)


def refuse_lost_task(problem: TuningProblem, progress: Progress) -> None:
    """Refuse a problem whose nominal flight fails by what no gains can mend.

    Args:
        problem: problem to solve.
        progress: line that shows what is done.

    Raises:
        CannotStart: it does.
    """
    if not problem.start_fails:
        return
    progress.show("the starting gains lose the glider; looking why ...")
    why, of_the_task = why_lost(problem)
    progress.clear()
    if of_the_task:
        raise CannotStart(f"nothing to tune: {why} No gains can mend that.")


def all_lost(problem: TuningProblem, losses: Sequence[float]) -> bool:
    """Whether all objectives are those of gains that lose every glider.

    Args:
        problem: problem to solve.
        losses: objectives of some gains on the training members.
    """
    return not min(losses) < HOPELESS * FAILED_COST * problem.cost_scale


def _change(before: float, after: float) -> float:
    return abs(after - before) / (abs(before) + 1e-12)


def why_lost(problem: TuningProblem) -> tuple[str, bool]:
    """Why the nominal flight with the starting gains is lost, in a sentence.

    And whether that is the task's fault, which no gains can mend.

    Args:
        problem: problem to solve.
    """
    loop = problem.loop
    key, scenario = jax.random.key(0), loop.scenario
    flown = jax.jit(simulate)(loop, scenario.sea(key), scenario.noise(key))
    run = jax.device_get(flown)
    failure = explain(loop, run)
    if failure is not None:
        return f"the nominal flight {failure.lines()[0]}", failure.of_the_task
    if bool(run.metrics.capsized):
        return "the nominal flight rolls past 90 deg.", False
    text = "the nominal flight survives, the members do not: try --uncertainty 0.05."
    return text, False
