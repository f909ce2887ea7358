"""Trust in the gradient of each gain, asked from Python."""

import dataclasses
from collections.abc import Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxglider.core.kept.programs import kept
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import evaluate
from jaxglider.uncertainty.members import with_member
from tuning.gradient_check.check import GradientReport, check_gradient, saturation
from tuning.gradient_check.comparison import (
    Comparison,
    compare_horizons,
    compare_smoothing,
)
from tuning.gradient_check.text import (
    comparison_to_dict,
    markdown,
    render,
    render_comparison,
    to_dict,
)
from tuning.problem.arguments import objective_of, texts
from tuning.problem.members import nominal_member
from tuning.problem.objective import Weights
from tuning.problem.objective_file import DEFAULT_WEIGHTS
from tuning.problem.problem import TuningProblem
from tuning.problem.spec import EnsembleSpec, ProblemSpec
from tuning.reporting.console import BarProgress, Progress, SilentProgress, note

SMOOTHING = (1e-4, 1e-3, 1e-2)
"""Smoothing widths δ that are compared."""
SHARES = (0.25, 0.5, 1.0)
"""Shares of the run that are compared."""


@dataclasses.dataclass(frozen=True)
class GradientCheck:
    """Result of a check of the gradient.

    Attributes:
        report: reverse mode against central differences, gain by gain.
        comparisons: changes of the gradient with the horizon and with the smoothing
            width; empty for a short check.
    """

    report: GradientReport
    comparisons: tuple[Comparison, ...]

    def __str__(self) -> str:
        """The tables and verdicts."""
        texts = [render(self.report), *map(render_comparison, self.comparisons)]
        return "\n\n".join(texts)

    def markdown(self) -> str:
        """The same for a page: the gains as a table, the comparisons as they are."""
        lines = markdown(self.report)
        for comparison in self.comparisons:
            lines += ["\n```", render_comparison(comparison), "```"]
        return "\n".join(lines) + "\n"

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers; None where not finite."""
        return {
            "report": to_dict(self.report),
            "comparisons": [comparison_to_dict(c) for c in self.comparisons],
        }


def check_gradients(
    loop: ClosedLoop,
    *,
    free: Sequence[str] = (),
    objective: Weights | str | Path = DEFAULT_WEIGHTS,
    short: bool = False,
    progress: bool = True,
) -> GradientCheck:
    """Compare the gradient of the nominal case with central differences.

    Double precision is needed for more than a coarse answer: call
    `jax.config.update("jax_enable_x64", True)` before the loop is made.

    Args:
        loop: closed loop with the gains to check at; any controller.
        free: dotted paths of the gains, `*` for any component; empty for all numbers of
            the controller and its observer.
        objective: weight of each term of the objective, or the path of an objective
            file.
        short: whether to leave out the comparison of horizons and smoothing widths.
        progress: whether to show a progress bar.

    Raises:
        ValueError: a path names nothing that can be tuned.
    """
    spec = ProblemSpec.of_loop(
        loop,
        free=texts("free", free),
        ensemble=EnsembleSpec.nominal(),
        weights=objective_of(objective)[0],
        gradient_memory=None,
    )
    shown = BarProgress() if progress else SilentProgress()
    return check_problem(spec, short=short, progress=shown)


def check_problem(
    spec: ProblemSpec, *, short: bool = False, progress: Progress | None = None
) -> GradientCheck:
    """Check the gradient of the nominal case of a problem.

    Args:
        spec: description of the problem.
        short: whether to leave out the comparison of horizons and smoothing widths.
        progress: line that shows how far it is; none by default.

    Raises:
        ValueError: the problem cannot be put together.
    """
    progress = progress or SilentProgress()
    progress.show("compiling the rollout ...")
    problem = TuningProblem.of(spec)
    member = jax.tree.map(lambda x: x[0], nominal_member(problem.loop))
    free = problem.space.read(problem.loop)
    progress.clear()
    for text in problem.space.notes:
        note(text)
    progress.show("compiling the gradient and differences ...")
    loop = problem.space.write(problem.loop, free)
    metrics = kept(evaluate)(*with_member(loop, member))
    report = check_gradient(
        lambda x: problem.loss(x, member),
        free,
        problem.space.names,
        saturated=saturation(metrics),
    )
    comparisons: tuple[Comparison, ...] = ()
    if not short:
        progress.show("comparing horizons and smoothing widths ...")
        comparisons = (
            compare_horizons(_by_horizon(spec), free),
            compare_smoothing(
                lambda x, delta: _with_smoothing(problem, delta).loss(x, member),
                SMOOTHING,
                free,
            ),
        )
    progress.clear()
    return GradientCheck(report, comparisons)


def _by_horizon(spec: ProblemSpec) -> Mapping[float, Any]:
    """The same objective on a quarter, half and the whole of the run."""
    clock = spec.loop.scenario.clock
    whole = float(clock.ticks * clock.dt)
    return {
        share * whole: _nominal_loss(TuningProblem.of(spec.lasting(share * whole)))
        for share in SHARES
    }


def _nominal_loss(problem: TuningProblem) -> Any:
    member = jax.tree.map(lambda x: x[0], nominal_member(problem.loop))
    return lambda x: problem.loss(x, member)


def _with_smoothing(problem: TuningProblem, delta: Any) -> TuningProblem:
    """The problem with δ of controller and observer changed, where they have one."""
    loop = problem.loop
    for part in ("controller", "observer"):
        if hasattr(getattr(loop, part), "smoothing"):
            where = attrgetter(f"{part}.smoothing")
            loop = eqx.tree_at(where, loop, jnp.asarray(delta))
    return dataclasses.replace(problem, loop=loop)
