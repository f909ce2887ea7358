"""The command that tunes: descend, choose on members not descended on, report."""

import argparse
import hashlib
import json
import sys
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import tomli_w

from jaxglider.files.gains import encode_law
from jaxglider.files.mission import self_contained
from jaxglider.files.writing import provenance, write_json, write_text
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.evaluation.held_out import Judge, verdict
from tuning.evaluation.report import history_table, text_report, write_tuning_report
from tuning.problem.lanes import member_count
from tuning.problem.problem import TuningProblem, build_task
from tuning.reporting.console import Progress, check_writable, note, print_result
from tuning.reporting.exit_codes import INTERRUPTED, OK
from tuning.search.black_box import black_box
from tuning.search.checkpoint import Checkpoint
from tuning.search.descend import beside, descend, started
from tuning.search.settings import DescentSettings, Step

_CONTINUES = ("out", "resume", "json", "debug", "command", "no_check")


def tune(options: argparse.Namespace) -> int:
    """`jaxglider tune`: gradient descent through the rollout."""
    settings = DescentSettings(
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
            state, descent, remarks = started(options, task, start, settings, progress)
            # While it descends on one core, the other compiles what judges.
            seen = beside(judge, task.loop)
            chosen, history, interrupted = descend(
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
    before = seen.result() if seen else judge(task.loop)
    judged = verdict(task, before, judge(tuned))
    progress.clear()
    result = _result(options, task, tuned, history, judged)
    result["notes"] = [*task.space.notes, *remarks]
    result["seconds"] = round(time.monotonic() - begun, 1)
    result["provenance"]["partial"] = interrupted
    _write(options.out, task, tuned, history, result)
    print_result(result, text_report(result), as_json=options.json)
    note(f"{options.out}: gains.toml, history.csv, tune.json and report.md.")
    return INTERRUPTED if interrupted else OK


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


def _result(
    options: argparse.Namespace,
    task: TuningProblem,
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
            name: member_count(members)
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
    task: TuningProblem,
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
    write_tuning_report(out, task, tuned, history, result)
