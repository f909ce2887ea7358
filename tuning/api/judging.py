"""Judgement of what a search came to: stable, held out, right, and robust."""

import time
from concurrent.futures import Future
from typing import Any

import jax
import jax.numpy as jnp

from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.api.results import TuneResult
from tuning.evaluation.final_gradient import GradientProbe
from tuning.evaluation.held_out import Judge, Judged, Verdict, compare_held_out
from tuning.evaluation.robustness import (
    TICK_FACTORS,
    Robustness,
    judge_robustness,
    with_tick,
)
from tuning.gradient_check.statement import GradientStatement
from tuning.problem.problem import TuningProblem
from tuning.reporting.console import Progress, note
from tuning.search.adversarial import AdversarialRound, Adversary
from tuning.search.beginning import beside
from tuning.search.descend import SearchOutcome
from tuning.search.stable import stable_choice


class Judges:
    """Judges of tuned gains: on held-out members, and if asked of their gradient too.

    While a descent goes on on one core, they compile on the other.
    """

    def __init__(self, problem: TuningProblem, check: bool) -> None:
        """Prepare.

        Args:
            problem: problem to solve.
            check: whether to look at the gradient, other ticks and roundings.
        """
        self._problem, self._judge = problem, Judge(problem)
        self._probe = GradientProbe(problem) if check else None
        self._before: Future[Judged] | None = None
        self._others: list[Future[Any]] = []

    def begin(self) -> None:
        """Judge the starting gains beside what else is done, compiling all."""
        self._before = beside(self._judge, self._problem.loop)
        if self._probe is not None:
            loops = [with_tick(self._problem.loop, x) for x in TICK_FACTORS]
            self._others = [beside(self._judge.metrics, loop) for loop in loops]
            self._others.append(beside(self._probe, self._problem.loop))

    def __call__(
        self, tuned: ClosedLoop, progress: Progress
    ) -> tuple[Verdict, GradientStatement | None, Robustness | None]:
        """The verdict on tuned gains, and what was asked for besides."""
        progress.show("judging on held-out members ...")
        begun = self._before
        before = self._judge(self._problem.loop) if begun is None else begun.result()
        verdict = compare_held_out(self._problem, before, self._judge(tuned))
        if self._probe is None:
            return verdict, None, None
        for other in self._others:  # only their compiled programs are of use
            other.result()
        gradient = self._probe(tuned)
        progress.show("judging at other ticks and from other roundings ...")
        return verdict, gradient, judge_robustness(self._judge, tuned)


def judged_result(
    problem: TuningProblem,
    outcome: SearchOutcome,
    adversary: Adversary | None,
    judges: Judges,
    progress: Progress,
    method: str,
    begun: float,
) -> TuneResult:
    """The result of a search: its best stable gains, judged on members not seen.

    Args:
        problem: problem that was searched; that of the adversary where there is one.
        outcome: outcome of the search.
        adversary: adversary that found members which joined, or None.
        judges: judges of the gains.
        progress: line that shows how far it is.
        method: name of the search.
        begun: time that all began at, of the monotonic clock [s].
    """
    progress.show("looking whether the loop is stable on its glides ...")
    choice = stable_choice(problem, outcome.free, outcome.candidates)
    searches: tuple[AdversarialRound, ...] = ()
    if adversary is not None:
        progress.show("searching for the worst members ...")
        problem = adversary.joined(outcome.rounds)
        number = outcome.history[-1].number
        last = adversary.search(choice.free, number, outcome.rounds)
        searches = (*outcome.rounds, last)
    # By way of the host, off all devices but one: else judging would compile twice.
    tuned = problem.space.write(problem.loop, jnp.asarray(jax.device_get(choice.free)))
    verdict, gradient, robust = judges(tuned, progress)
    remarks = [
        *choice.remarks,
        *([] if gradient is None else [gradient.text()]),
        *([] if robust is None else robust.remarks()),
    ]
    progress.clear()
    for text in remarks:
        note(text)
    return TuneResult(
        problem=problem,
        loop=tuned,
        verdict=verdict,
        history=outcome.history,
        method=method,
        notes=(*problem.space.notes, *outcome.remarks, *remarks),
        gradient=gradient,
        robustness=robust,
        searches=searches,
        interrupted=outcome.interrupted,
        seconds=time.monotonic() - begun,
    )
