"""Tuning from Python: a closed loop in, tuned gains and a held-out verdict out."""

import dataclasses
import time
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from jaxglider.core.kept.fingerprint import fingerprint
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.uncertainty.members import Uncertainty
from tuning.api.judging import Judges, judged_result
from tuning.api.results import TuneResult
from tuning.problem.aggregates import AbstractAggregate
from tuning.problem.arguments import instance, objective_of, refuse, texts, whole
from tuning.problem.objective import Cost, Weights
from tuning.problem.objective_file import DEFAULT_WEIGHTS
from tuning.problem.problem import TuningProblem
from tuning.problem.spec import DEFAULT_UNCERTAINTY, EnsembleSpec, ProblemSpec
from tuning.reporting.console import BarProgress, Progress, SilentProgress, note
from tuning.reporting.output_folder import writing_to
from tuning.search.adversarial import Adversary, refuse_rounds
from tuning.search.black_box import search_black_box
from tuning.search.checkpoint import Checkpoint
from tuning.search.descend import SearchOutcome, descend
from tuning.search.settings import BlackBoxSettings, DescentSettings
from tuning.space.space import HELD_BY_DEFAULT


def tune(
    loop: ClosedLoop,
    *,
    free: Sequence[str] = (),
    members: int = 32,
    validation: int = 32,
    test: int = 64,
    uncertainty: Uncertainty | float = DEFAULT_UNCERTAINTY,
    seed: int = 0,
    objective: Weights | str | Path = DEFAULT_WEIGHTS,
    cost: Cost | None = None,
    aggregate: AbstractAggregate | str | None = None,
    constraints: Sequence[str] = HELD_BY_DEFAULT,
    gradient_memory: float | None = 150.0,
    steps: int | None = None,
    settings: DescentSettings | None = None,
    method: BlackBoxSettings | None = None,
    adversarial: int = 0,
    title: str = "own",
    out: str | Path | None = None,
    resume: bool = False,
    check: bool = True,
    progress: bool = True,
) -> TuneResult:
    """Tune the gains of a closed loop by gradient descent through its rollout.

    Double precision is worth it: call `jax.config.update("jax_enable_x64", True)`
    before the loop is made.

    Args:
        loop: closed loop with the gains to start from; any controller, also one of your
            own.
        free: dotted paths of what is tuned, `*` for any component; empty for all
            numbers of the controller and its observer.
        members: number of gliders and seas to descend on; 1 is the nominal case alone.
        validation: number of members that the best step is chosen by.
        test: number of members held out for the verdict.
        uncertainty: quantities that differ between members; or one relative half width
            in [0, 1) for masses, inertias, coefficients and waves.
        seed: seed of members and of the search.
        objective: weight of each term of the objective, or the path of an objective
            file.
        cost: cost function of metrics and of those at the start, instead of the
            weighted terms.
        aggregate: mean, CVaR or soft worst of the members' costs, or `mean`, `cvar` or
            `worst`; that of an objective file, else the mean, by default.
        constraints: names of the coupled constraints that are held; by default the
            funnel is kept inside the specification.
        gradient_memory: memory of the gradient [s]; None for the exact one.
        steps: number of steps, a short way to set `settings`.
        settings: settings of the descent; its seed is replaced by `seed`.
        method: search without gradients instead, on the same budget.
        adversarial: number of rounds in which the worst members for the gains reached
            are searched for and join those tuned on, and the descent goes on.
        title: name of what is flown, for reports.
        out: folder for a checkpoint after every step and for all results.
        resume: whether to go on from the checkpoint in `out`.
        check: whether to check the gradient against differences, first and at the end,
            and to judge the gains at half and twice the tick and from roundings.
        progress: whether to show a progress bar.

    Raises:
        ValueError: an argument cannot be used.
        FloatingPointError: no start completes its run.
    """
    whole("members", members)
    whole("adversarial", adversarial, 0)
    instance("settings", settings, DescentSettings)
    instance("method", method, BlackBoxSettings, ", as BlackBoxSettings('cma'),")
    if cost is not None and not callable(cost):
        raise refuse("cost", "a function or None", cost)
    weights, chosen_aggregate = objective_of(objective, aggregate)
    spec = ProblemSpec.of_loop(
        loop,
        title,
        free=texts("free", free),
        ensemble=EnsembleSpec(uncertainty, members, validation, test, seed),
        weights=weights,
        cost=cost,
        aggregate=chosen_aggregate,
        constraints=texts("constraints", constraints),
        gradient_memory=gradient_memory,
    )
    chosen = settings or DescentSettings()
    if steps is not None:
        chosen = dataclasses.replace(chosen, steps=whole("steps", steps))
    chosen = dataclasses.replace(chosen, seed=seed)
    with nullcontext() if out is None else writing_to(Path(out)):
        result = solve(
            spec,
            chosen,
            method,
            adversarial=adversarial,
            out=out,
            resume=resume,
            check=check,
            progress=BarProgress() if progress else SilentProgress(),
        )
        if out is not None:
            result.save(out)
    return result


def solve(
    spec: ProblemSpec,
    settings: DescentSettings,
    method: BlackBoxSettings | None = None,
    *,
    adversarial: int = 0,
    out: str | Path | None = None,
    resume: bool = False,
    check: bool = True,
    progress: Progress | None = None,
) -> TuneResult:
    """Solve a tuning problem; nothing but the checkpoint is written.

    Args:
        spec: problem to solve.
        settings: settings of the descent.
        method: search without gradients instead, on the budget of the descent.
        adversarial: number of adversarial rounds after the descent.
        out: folder for a checkpoint after every step, or None.
        resume: whether to go on from the checkpoint in `out`.
        check: whether to check the gradient against differences, first and at the end,
            and to judge the gains at half and twice the tick and from roundings.
        progress: line that shows how far it is; none by default.

    Raises:
        ValueError: the problem cannot be put together, or there is no checkpoint of it.
        FloatingPointError: no start completes its run.
    """
    begun = time.monotonic()
    progress = progress or SilentProgress()
    if adversarial:
        refuse_rounds(spec, method, adversarial)
    rounds = [adversarial] if adversarial else []
    checkpoint = _checkpoint(out, [spec, settings, method, *rounds], resume)
    progress.show("compiling the rollout ...")
    problem = TuningProblem.of(spec)
    adversary = Adversary(problem, adversarial, settings.seed) if adversarial else None
    if adversary is not None:
        problem = adversary.problem
    progress.clear()
    for text in problem.space.notes:
        note(text)
    judges = Judges(problem, check)

    def searched() -> SearchOutcome:
        if method is not None:
            return search_black_box(problem, method, settings, progress)
        return descend(
            problem,
            settings,
            progress,
            adversary=adversary,
            checkpoint=checkpoint,
            resume=resume,
            check=check,
            meanwhile=judges.begin,
        )

    try:
        outcome = searched()
    finally:
        progress.clear()
    name = "gradient" if method is None else method.method
    return judged_result(problem, outcome, adversary, judges, progress, name, begun)


def _checkpoint(
    out: str | Path | None, about: list[Any], resume: bool
) -> Checkpoint | None:
    """The checkpoint in a folder, looked at where a search goes on from it.

    Raises:
        ValueError: there is none of this problem to go on from.
    """
    if out is None:
        if resume:
            raise ValueError("resume goes with out, the folder of the checkpoint.")
        return None
    checkpoint = Checkpoint(Path(out) / "checkpoint.npz", fingerprint(about))
    if resume:
        checkpoint.about()
    return checkpoint
