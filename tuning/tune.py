"""The command that tunes: descend, choose on members not descended on, report."""

import argparse
import dataclasses
import hashlib
import json
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import tomli_w

from jaxglider._types import Series
from jaxglider.config import self_contained
from jaxglider.gains import encode_law
from jaxglider.io import provenance, write_json, write_text
from jaxglider.rollout import ClosedLoop
from jaxglider.scenario import Clock
from tuning.batch import size
from tuning.black_box import black_box
from tuning.checkpoint import Checkpoint
from tuning.descent import Descent
from tuning.descent_state import Settings, State, Step
from tuning.gradient_check import SHORT_STEPS, check_gradient
from tuning.members import nominal_member
from tuning.progress import Progress, note
from tuning.report import history_table, text_report, write_report
from tuning.rescue import is_lost, promising_start
from tuning.runs import check_writable, print_result
from tuning.task import Task, build_task
from tuning.verdict import Judge, verdict

T = TypeVar("T")
OK, RUN_FAILED, INTERRUPTED = 0, 1, 130
CHECKED = 100.0
"""How much of a run the gradient is checked on first [s]."""
_CONTINUES = ("out", "resume", "json", "debug", "command", "no_check")


def tune(options: argparse.Namespace) -> int:
    """`jaxglider tune`: gradient descent through the rollout."""
    settings = Settings(
        steps=options.steps,
        learning_rate=options.learning_rate,
        optimiser=options.optimizer,
        patience=options.patience,
        starts=options.starts,
        seed=options.seed,
    )
    checkpoint = Checkpoint(options.out / "checkpoint.npz", fingerprint(options))
    if options.resume:
        checkpoint.about()
    check_writable(options.out)
    begun = time.monotonic()
    progress = Progress()
    progress.show("compiling the rollout ...")
    task = build_task(options)
    progress.clear()
    for text in task.space.notes:
        note(text)
    start = task.space.read(task.loop)
    remarks: tuple[str, ...] = ()
    judge, seen = Judge(task), None
    try:
        if options.method == "gradient":
            state, descent, remarks = _started(options, task, start, settings, progress)
            # While it descends on one core, the other compiles what judges.
            seen = _beside(judge, task.loop)
            chosen, history, interrupted = _descend(
                descent, state, checkpoint, options.resume, progress
            )
        else:
            progress.show("compiling the search ...")
            chosen, history, interrupted = black_box(
                options.method,
                task,
                start,
                settings,
                progress,
                options.population,
                spread=options.spread,
            )
    finally:
        progress.clear()
    # By way of the host, off all devices but one: else judging would compile twice.
    tuned = task.space.write(task.loop, jnp.asarray(jax.device_get(chosen)))
    progress.show("judging on held-out members ...")
    judged = verdict(task, tuned, judge, seen.result() if seen else None)
    progress.clear()
    result = _result(options, task, tuned, history, judged)
    result["notes"] = [*task.space.notes, *remarks]
    result["seconds"] = round(time.monotonic() - begun, 1)
    result["provenance"]["partial"] = interrupted
    _write(options.out, task, tuned, history, result)
    print_result(result, text_report(result), as_json=options.json)
    note(f"{options.out}: gains.toml, history.csv, tune.json and report.md.")
    return INTERRUPTED if interrupted else OK


def _started(
    options: argparse.Namespace,
    task: Task,
    start: Series,
    settings: Settings,
    progress: Progress,
) -> tuple[State, Descent, tuple[str, ...]]:
    """A descent at its start, or at a better one if this is lost; and remarks."""
    check = None if options.no_check else _beside(_trust, task, start)
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
        start, _, text = promising_start(
            task, start, float(state.loss[0]), options.seed, progress.show
        )
        remarks.append(text)
        state = descent.start(start)
    progress.clear()
    for text in remarks:
        note(text)
    return state, descent, tuple(remarks)


def _beside(function: Callable[..., T], *args: Any) -> "Future[T]":
    """Call in a thread of its own: what it compiles costs no time on a second core."""
    pool = ThreadPoolExecutor(1)
    future = pool.submit(function, *args)
    pool.shutdown(wait=False)
    return future


def _trust(task: Task, start: Series) -> str:
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


def fingerprint(options: argparse.Namespace) -> str:
    """A digest of every option that the steps depend on: what `--resume` must find."""
    kept = {
        key: _content(key, value)
        for key, value in sorted(vars(options).items())
        if key not in _CONTINUES
    }
    return hashlib.sha256(json.dumps(kept).encode()).hexdigest()[:16]


def _content(key: str, value: Any) -> Any:
    """A file counts by what it holds; a missing one is refused where it is read."""
    if key == "config" and value is not None:
        return self_contained(value)
    if key == "cost" and value is not None:
        file = Path(value.rpartition(":")[0])
        return [value, file.read_text() if file.is_file() else ""]
    if isinstance(value, Path):
        return value.read_text() if value.is_file() else str(value)
    return list(value) if isinstance(value, list | tuple) else value


def _descend(
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


def _result(
    options: argparse.Namespace,
    task: Task,
    tuned: ClosedLoop,
    history: list[Step],
    judged: dict[str, Any],
) -> dict[str, Any]:
    return {
        "scenario": task.case.title,
        "plant": task.case.plant,
        "mission": None if options.config is None else str(options.config),
        "controller": task.kind,
        "method": options.method,
        "steps": history[-1].number,
        "refused": sum(step.refused for step in history),
        "members": {
            name: size(members)
            for name, members in (
                ("training", task.training),
                ("validation", task.validation),
                ("test", task.test),
            )
        },
        "gains": {
            name: {"before": before, "after": after}
            for (name, before), after in zip(
                task.space.values(task.loop).items(),
                task.space.values(tuned).values(),
                strict=True,
            )
        },
        **judged,
        "provenance": provenance(command=sys.argv[1:], precision=options.precision),
    }


def _write(
    out: Path,
    task: Task,
    tuned: ClosedLoop,
    history: list[Step],
    result: dict[str, Any],
) -> None:
    about = result["provenance"]
    gains = {
        **encode_law(tuned),
        "provenance": {
            "command": "jaxglider " + " ".join(about["command"]),
            "created": about["created"],
            "scenario": result["scenario"],
            "plant": result["plant"],
            **({"mission": result["mission"]} if result["mission"] else {}),
            "versions": about["versions"],
        },
    }
    write_text(out / "gains.toml", tomli_w.dumps(gains))
    write_text(out / "history.csv", history_table(task, history))
    write_json(out / "tune.json", result)
    write_report(out, task, tuned, history, result)
