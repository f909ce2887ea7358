"""A descent from its start to its end, with what goes on beside it."""

import dataclasses
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from jaxglider.core.containers import Series
from jaxglider.simulation.rollout import with_ticks
from tuning.gradient_check.check import SHORT_STEPS, check_gradient
from tuning.problem.members import nominal_member
from tuning.problem.problem import TuningProblem
from tuning.reporting.console import Progress, note
from tuning.search.checkpoint import Checkpoint
from tuning.search.descent import Descent
from tuning.search.rescue import (
    cannot_start,
    is_lost,
    promising_gains,
    refuse_lost_task,
)
from tuning.search.settings import DescentSettings, State, Step

T = TypeVar("T")
CHECKED = 100.0
"""Length of the beginning of a run on which the gradient is checked first [s]."""


@dataclasses.dataclass(frozen=True)
class SearchOutcome:
    """Result of a search.

    Attributes:
        free: free numbers that are best on the validation members.
        history: steps of the search, the start first.
        remarks: sentences on the start and the gradient, for a report.
        interrupted: whether the search was stopped before its end.
    """

    free: Series
    history: list[Step]
    remarks: tuple[str, ...] = ()
    interrupted: bool = False


def descend(
    problem: TuningProblem,
    settings: DescentSettings,
    progress: Progress,
    *,
    checkpoint: Checkpoint | None = None,
    resume: bool = False,
    check: bool = True,
    meanwhile: Callable[[], Any] = lambda: None,
) -> SearchOutcome:
    """Descend to the end or to an interruption; what was reached is kept.

    Args:
        problem: problem to solve.
        settings: settings of the descent.
        progress: line that shows how far it is.
        checkpoint: file that every step is kept in, or None.
        resume: whether to go on from the checkpoint.
        check: whether to check the gradient against differences at the start.
        meanwhile: function called once the descent has compiled, before its first step.

    Raises:
        FloatingPointError: the objective is not finite at any start.
        CannotStart: no gains that a search tried keep the gliders.
        ValueError: the checkpoint cannot be gone on with.
    """
    descent, state, remarks = _start(problem, settings, progress, resume, check)
    for remark in remarks:
        note(remark)
    meanwhile()
    leader = state.leader()
    history = [
        Step(
            number=0,
            loss=float(state.current.loss[leader]),
            validation=float(state.chosen_loss[leader]),
            free=state.current.free[leader],
            refused=False,
            best=True,
            learning_rate=settings.learning_rate,
        )
    ]
    if resume and checkpoint is not None:
        state, history = checkpoint.load(state)
        note(f"resumed after step {int(state.number)}.")
    begun, first = time.monotonic(), int(state.number)
    interrupted = False
    try:
        for reached, step in descent.run(state):
            state = reached
            history.append(step)
            if checkpoint is not None:
                checkpoint.save(state, history)
            pace = (time.monotonic() - begun) / max(step.number - first, 1)
            progress.show(
                _line(step, state, settings, pace), step.number, settings.steps
            )
    except KeyboardInterrupt:
        interrupted = True
        progress.clear()
        how = " (go on with --resume)" if checkpoint is not None else ""
        note(f"interrupted; keeping the best gains so far{how}.")
    if not interrupted and descent.is_blind(state):
        progress.clear()
        note(
            "the descent ended early: no gradient is finite at these gains, where the "
            "loop amplifies every difference. Try --method cma, other --gains, a "
            "shorter --gradient-memory or --precision 64."
        )
    chosen = state.chosen_free[state.leader()]
    return SearchOutcome(chosen, history, remarks, interrupted)


def beside(function: Callable[..., T], *args: Any) -> "Future[T]":
    """Call in a thread of its own: what it compiles costs no time on a second core."""
    pool = ThreadPoolExecutor(1)
    future = pool.submit(function, *args)
    pool.shutdown(wait=False)
    return future


def _start(
    problem: TuningProblem,
    settings: DescentSettings,
    progress: Progress,
    resume: bool,
    check: bool,
) -> tuple[Descent, State, tuple[str, ...]]:
    """A descent at its start, or at a better one if this is lost; and remarks.

    What is lost on the nominal case is looked at before the gradient is compiled.
    """
    given = problem.space.read(problem.loop)
    found: list[str] = []
    if not resume and problem.starts_lost:
        refuse_lost_task(problem, progress)
        progress.show("the starting gains lose the glider; compiling a search ...")
        given = _rescued(problem, given, None, settings, progress, found)
    checking = beside(_gradient_remark, problem, given) if check else None
    progress.show(f"compiling the gradient{', checking it' if check else ''} ...")
    descent = Descent(
        problem.loss,
        problem.training,
        problem.validation,
        settings,
        problem.spec.aggregate,
        surrogate_loss=problem.surrogate_loss,
        cost_scale=problem.cost_scale,
        devices=jax.devices(),
    )
    state = descent.start(given)
    remarks = [checking.result()] if checking else []
    if not resume and not found and is_lost(state.current.loss, problem.cost_scale):
        objective = float(state.current.loss[0])
        state = descent.start(
            _rescued(problem, given, objective, settings, progress, found)
        )
    progress.clear()
    return descent, state, (*remarks, *found)


def _rescued(
    problem: TuningProblem,
    given: Series,
    objective: float | None,
    settings: DescentSettings,
    progress: Progress,
    remarks: list[str],
) -> Series:
    """Free numbers to descend from, found by a search; what it says is a remark.

    Raises:
        CannotStart: the search came to nothing.
    """
    rescue = promising_gains(problem, given, objective, settings.seed, progress.show)
    if rescue.tried:
        progress.show("looking why the gliders are lost ...")
        error = cannot_start(problem, rescue)
        progress.clear()
        raise error
    remarks.extend([rescue.remark] if rescue.remark else [])
    return rescue.free


def _line(step: Step, state: State, settings: DescentSettings, pace: float) -> str:
    """Progress of the descent, in one line."""
    return (
        f"step {step.number}/{settings.steps}  "
        f"objective {step.loss:.4f}  validation {step.validation:.4f}  "
        f"best {float(jnp.min(state.chosen_loss)):.4f}  "
        f"{'refused  ' if step.refused else ''}"
        f"{pace * (settings.steps - step.number):.0f} s left"
    )


def _gradient_remark(problem: TuningProblem, start: Series) -> str:
    """Whether the derivative at the start is exact, and how far it predicts.

    On the beginning of the nominal case: differences of a long run are rounding.
    """
    clock = problem.loop.scenario.clock
    ticks = min(clock.ticks, round(CHECKED / float(clock.dt)))
    brief = with_ticks(problem.loop, ticks)
    beginning = dataclasses.replace(problem, loop=brief)
    member = jax.tree.map(lambda x: x[0], nominal_member(brief))
    report = check_gradient(
        lambda x: beginning.loss(x, member),
        start,
        problem.space.names,
        steps=SHORT_STEPS,
        copies=1,
    )
    seconds = ticks * float(clock.dt)
    return f"gradient over the nominal case's first {seconds:g} s: {report.verdict}."
