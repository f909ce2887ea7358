"""Descent of the tuning command: its start, what is done beside it, and its end."""

import argparse
import dataclasses
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.containers import Series
from jaxglider.simulation.scenario import Clock
from tuning.gradient_check.check import SHORT_STEPS, check_gradient
from tuning.problem.members import nominal_member
from tuning.problem.problem import TuningProblem
from tuning.reporting.console import Progress, note
from tuning.search.checkpoint import Checkpoint
from tuning.search.descent import Descent
from tuning.search.rescue import is_lost, promising_gains
from tuning.search.settings import DescentSettings, State, Step

T = TypeVar("T")
CHECKED = 100.0
"""How much of a run the gradient is checked on first [s]."""


def started(
    options: argparse.Namespace,
    task: TuningProblem,
    start: Series,
    settings: DescentSettings,
    progress: Progress,
) -> tuple[State, Descent, tuple[str, ...]]:
    """A descent at its start, or at a better one if this is lost; and remarks."""
    check = None if options.no_check else beside(_trust, task, start)
    progress.show(f"compiling the gradient{', checking it' if check else ''} ...")
    descent = Descent(
        task.loss,
        task.training,
        task.validation,
        settings,
        task.aggregate,
        guide=task.guide,
        unit=task.unit,
        devices=jax.devices(),
    )
    state = descent.start(start)
    remarks = [check.result()] if check else []
    if not options.resume and is_lost(state.loss, task.unit):
        start, _, text = promising_gains(
            task, start, float(state.loss[0]), options.seed, progress.show
        )
        remarks.append(text)
        state = descent.start(start)
    progress.clear()
    for text in remarks:
        note(text)
    return state, descent, tuple(remarks)


def descend(
    descent: Descent,
    state: State,
    checkpoint: Checkpoint,
    resume: bool,
    progress: Progress,
) -> tuple[Series, list[Step], bool]:
    """Descend to the end or to an interruption; what was reached is kept."""
    leader = state.leader()
    start = Step(
        0,
        float(state.loss[leader]),
        float(state.chosen_loss[leader]),
        state.free[leader],
        False,
        True,
        descent.settings.learning_rate,
    )
    history = [start]
    if resume:
        state, history = checkpoint.load(state)
        note(f"resumed after step {int(state.number)}.")
    begun, first = time.monotonic(), int(state.number)
    try:
        for reached, step in descent.run(state):
            state = reached
            history.append(step)
            checkpoint.save(state, history)
            pace = (time.monotonic() - begun) / max(step.number - first, 1)
            progress.show(
                f"step {step.number}/{descent.settings.steps}  "
                f"objective {step.loss:.4f}  validation {step.validation:.4f}  "
                f"best {float(jnp.min(state.chosen_loss)):.4f}  "
                f"{'refused  ' if step.refused else ''}"
                f"{pace * (descent.settings.steps - step.number):.0f} s left"
            )
    except KeyboardInterrupt:
        progress.clear()
        note("interrupted; keeping the best gains so far (go on with --resume).")
        return state.chosen[state.leader()], history, True
    if descent.is_blind(state):
        progress.clear()
        note(
            "the descent ended early: no gradient is finite at these gains, where the "
            "loop amplifies every difference. Try --method cma, other --gains, a "
            "shorter --gradient-memory or --precision 64."
        )
    return state.chosen[state.leader()], history, False


def beside(function: Callable[..., T], *args: Any) -> "Future[T]":
    """Call in a thread of its own: what it compiles costs no time on a second core."""
    pool = ThreadPoolExecutor(1)
    future = pool.submit(function, *args)
    pool.shutdown(wait=False)
    return future


def _trust(task: TuningProblem, start: Series) -> str:
    """Whether the derivative at the start is exact, and how far it foretells.

    On the beginning of the nominal case: differences of a long run are rounding.
    """
    clock = task.loop.scenario.clock
    ticks = min(clock.ticks, round(CHECKED / float(clock.dt)))
    brief = eqx.tree_at(
        lambda loop: loop.scenario.clock, task.loop, Clock(ticks, clock.dt)
    )
    beginning = dataclasses.replace(task, loop=brief)
    member = jax.tree.map(lambda x: x[0], nominal_member(brief))
    report = check_gradient(
        lambda x: beginning.loss(x, member),
        start,
        task.space.names,
        steps=SHORT_STEPS,
        copies=1,
    )
    seconds = ticks * float(clock.dt)
    return f"gradient over the nominal case's first {seconds:g} s: {report.verdict}."
