"""The command that says how far gradients can be trusted."""

import argparse
import copy
import dataclasses
import sys
from operator import attrgetter
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.files.writing import provenance
from jaxglider.simulation.rollout import evaluate
from jaxglider.uncertainty.members import with_member
from tuning.gradient_check.check import check_gradient, saturation
from tuning.gradient_check.comparison import compare_horizons, compare_smoothing
from tuning.gradient_check.text import (
    comparison_to_dict,
    render,
    render_comparison,
    to_dict,
)
from tuning.problem.members import nominal_member
from tuning.problem.problem import TuningProblem, build_task
from tuning.reporting.console import Progress, note, print_result
from tuning.reporting.exit_codes import OK

SMOOTHING = (1e-4, 1e-3, 1e-2)


def check(options: argparse.Namespace) -> int:
    """`jaxglider check-gradients`: reverse mode against differences, gain by gain."""
    progress = Progress()
    progress.show("compiling the rollout ...")
    task = build_task(options)
    member = jax.tree.map(lambda x: x[0], nominal_member(task.loop))
    free = task.space.read(task.loop)
    progress.clear()
    for text in task.space.notes:
        note(text)
    progress.show("compiling the gradient and differences ...")
    metrics = jax.jit(evaluate)(*with_member(task.space.write(task.loop, free), member))
    report = check_gradient(
        lambda x: task.loss(x, member),
        free,
        task.space.names,
        saturated=saturation(metrics),
    )
    comparisons = []
    if not options.short:
        progress.show("comparing horizons and smoothing widths ...")
        comparisons = [
            compare_horizons(_by_horizon(options, task), free),
            compare_smoothing(
                lambda x, delta: _with_smoothing(task, delta).loss(x, member),
                SMOOTHING,
                free,
            ),
        ]
    progress.clear()
    result = {
        "report": to_dict(report),
        "comparisons": [comparison_to_dict(c) for c in comparisons],
        "provenance": provenance(command=sys.argv[1:], precision=options.precision),
    }
    texts = [render(report), *(render_comparison(c) for c in comparisons)]
    print_result(result, "\n\n".join(texts), as_json=options.json)
    return OK


def _by_horizon(options: argparse.Namespace, task: TuningProblem) -> dict[float, Any]:
    """The same objective on a quarter, half and the whole of the run."""
    whole = float(task.loop.scenario.clock.ticks * task.loop.scenario.clock.dt)
    losses = {}
    for share in (0.25, 0.5, 1.0):
        shorter = copy.copy(options)
        shorter.duration = share * whole
        part = build_task(shorter)
        member = jax.tree.map(lambda x: x[0], nominal_member(part.loop))
        losses[shorter.duration] = _loss_of(part, member)
    return losses


def _loss_of(task: TuningProblem, member: Any) -> Any:
    return lambda x: task.loss(x, member)


def _with_smoothing(task: TuningProblem, delta: Any) -> TuningProblem:
    """The task with δ of controller and observer changed, where they have one."""
    loop = task.loop
    for part in ("controller", "observer"):
        if hasattr(getattr(loop, part), "smoothing"):
            where = attrgetter(f"{part}.smoothing")
            loop = eqx.tree_at(where, loop, jnp.asarray(delta))
    return dataclasses.replace(task, loop=loop)
