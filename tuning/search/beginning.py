"""The beginning of a descent: from gains worth it, its gradient checked."""

import dataclasses
import functools
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import jax

from jaxglider.core.containers import Series
from jaxglider.simulation.rollout import with_ticks
from tuning.gradient_check.check import SHORT_STEPS, check_gradient
from tuning.problem.members import nominal_member
from tuning.problem.problem import TuningProblem
from tuning.reporting.console import Progress
from tuning.search.descent import Descent
from tuning.search.rescue import (
    cannot_start,
    is_lost,
    promising_gains,
    refuse_lost_task,
)
from tuning.search.settings import DescentSettings, State
from tuning.search.stable import loop_is_stable

T = TypeVar("T")
CHECKED = 100.0
"""Length of the beginning of a run on which the gradient is checked first [s]."""


def begin(
    problem: TuningProblem,
    settings: DescentSettings,
    progress: Progress,
    resume: bool,
    check: bool,
    meanwhile: Callable[[], Any] = lambda: None,
) -> tuple[Descent, State, tuple[str, ...]]:
    """A descent at its start, or at a better one if this is lost; and remarks.

    What is lost on the nominal case is looked at before the gradient is compiled.

    Args:
        problem: problem to solve.
        settings: settings of the descent.
        progress: line that shows how far it is.
        resume: whether a checkpoint is gone on from, so that the start is only a form.
        check: whether to check the gradient against differences.
        meanwhile: function called once the descent has compiled.

    Raises:
        CannotStart: no gains that a search tried keep the gliders.
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
    meanwhile()
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
    rescue = promising_gains(
        problem,
        given,
        objective,
        settings.seed,
        progress.show,
        functools.partial(loop_is_stable, problem),
    )
    if rescue.tried:
        progress.show("looking why the gliders are lost ...")
        error = cannot_start(problem, rescue)
        progress.clear()
        raise error
    remarks.extend([rescue.remark] if rescue.remark else [])
    return rescue.free


def beside(function: Callable[..., T], *args: Any) -> "Future[T]":
    """Call in a thread of its own: what it compiles costs no time on a second core."""
    pool = ThreadPoolExecutor(1)
    future = pool.submit(function, *args)
    pool.shutdown(wait=False)
    return future


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
