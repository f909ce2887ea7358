"""Monte Carlo campaigns from Python: closed loops in, probabilities out."""

import argparse
import dataclasses
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import equinox as eqx
import numpy as np

from jaxglider.core.kept.fingerprint import fingerprint
from jaxglider.files.gains import encode_law
from jaxglider.files.writing import provenance
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.uncertainty.members import Uncertainty
from jaxglider.uncertainty.quantities import uniform_uncertainty
from tuning.api.results import SweepResult
from tuning.campaign.analysis.requirements import Requirement, requirement
from tuning.campaign.analysis.summary import measures_of
from tuning.campaign.execute import Work
from tuning.campaign.report.conclude import (
    Conclusions,
    conclude,
    write_conclusions,
)
from tuning.campaign.run.campaign import Campaign, CampaignSettings, make_sampler
from tuning.campaign.run.rows import Rows
from tuning.campaign.run.store import Manifest, opened, prepare
from tuning.problem.arguments import closed_loops, half_width, real, texts, whole
from tuning.problem.case import FlightCase
from tuning.problem.gain_sets import GainSet
from tuning.problem.spec import DEFAULT_UNCERTAINTY, name_of
from tuning.reporting.console import BarProgress, Progress, SilentProgress, note
from tuning.reporting.output_folder import writing_to


def sweep(
    loops: ClosedLoop | Mapping[str, ClosedLoop],
    *,
    uncertainty: Uncertainty | float = DEFAULT_UNCERTAINTY,
    members: int = 1000,
    seed: int = 0,
    design: str = "monte-carlo",
    until_ci: float | None = None,
    confidence: float = 0.95,
    require: Sequence[str] = (),
    sensitivity: int = 0,
    title: str = "own",
    out: str | Path | None = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: bool = True,
) -> SweepResult:
    """Say how sure closed loops are: Monte Carlo over gliders and seas.

    All loops meet the same members and are compared with the first.

    Args:
        loops: closed loop, or closed loops by name, that fly one scenario; their
            controllers, observers and guidance gains may differ.
        uncertainty: quantities that differ between members; or one relative half width
            in (0, 1) for masses, inertias, coefficients and waves.
        members: number of members; the most there can be with `until_ci`.
        seed: seed of the members.
        design: placement of the members, `monte-carlo`, `latin-hypercube` or `sobol`.
        until_ci: width of the interval of leaving a funnel at which to stop.
        confidence: level of all intervals, in (0, 1).
        require: requirements, such as `p_violation<0.01`.
        sensitivity: number of blocks for Sobol indices; 0 for rank correlations alone.
        title: name of what is flown, for reports.
        out: folder that keeps every row at once, so that what is interrupted or killed
            can be gone on with; all results are written there.
        resume: whether to go on with the campaign in `out`.
        overwrite: whether to discard the campaign in `out`.
        progress: whether to show a progress bar.

    Raises:
        ValueError: an argument cannot be used, or the loops fly different scenarios.
        OSError: `out` cannot be written.
    """
    named = closed_loops(loops)
    whole("members", members)
    whole("seed", seed, 0, 2**32)
    whole("sensitivity", sensitivity, 0)
    real("confidence", confidence, 0.0, 1.0, "a number in (0, 1)")
    if until_ci is not None:
        real("until_ci", until_ci, 0.0, 1.0, "a number in (0, 1) or None")
    asked = texts("require", require)
    campaign = _campaign(named, uncertainty, members, seed, design, until_ci, title)
    conclusions = Conclusions(confidence, _rules(asked, campaign), sensitivity)
    shown: Progress = BarProgress() if progress else SilentProgress()
    if resume and out is None:
        raise ValueError("resume goes with out, the folder of the campaign.")
    with tempfile.TemporaryDirectory(prefix="jaxglider-") as scratch:
        folder = Path(scratch if out is None else out)
        with writing_to(folder):
            result = _run(campaign, folder, conclusions, shown, resume, overwrite)
            if out is not None:
                about = result.summary.provenance
                write_conclusions(
                    folder,
                    campaign,
                    Manifest.of(campaign, 0, members, about),
                    result.rows.rows,
                    result.summary,
                    report=True,
                    progress=shown,
                )
    return result


def _run(
    campaign: Campaign,
    folder: Path,
    conclusions: Conclusions,
    progress: Progress,
    resume: bool,
    overwrite: bool,
) -> SweepResult:
    """Run what is missing of a campaign; its rows are read into memory."""
    about = provenance(precision=campaign.settings.precision)
    manifest = Manifest.of(campaign, 0, campaign.settings.members, about)
    prepare(folder, manifest, resume=resume, overwrite=overwrite)
    work, kind = Work(campaign, progress), manifest.row_type()
    blocks, interrupted = None, False
    with opened(folder, kind, 0) as store:
        try:
            work.fill(store, 0, campaign.settings.members)
            if conclusions.sensitivity:
                blocks = work.blocks(
                    folder / "sobol.bin", kind, conclusions.sensitivity
                )
                blocks = Rows(np.array(blocks.rows), blocks.labels)
        except KeyboardInterrupt:
            if store.count == 0:
                raise
            note(f"interrupted; the summary is of {store.count} members.")
            interrupted = True
        rows = np.array(store.rows())
    summary = conclude(conclusions, campaign, rows, about, blocks, progress)
    progress.clear()
    return SweepResult(campaign, Rows(rows, campaign.labels), summary, interrupted)


def _campaign(
    named: dict[str, ClosedLoop],
    uncertainty: Uncertainty | float,
    members: int,
    seed: int,
    design: str,
    until_ci: float | None,
    title: str,
) -> Campaign:
    """A campaign of closed loops that no file can tell."""
    if not named:
        raise ValueError("loops must hold at least one closed loop; received none.")
    first, *others = named
    case = FlightCase.of_loop(named[first], title)
    for name in others:
        _check_same_scenario(first, named[first], name, named[name])
    level: float | str = "from Python"
    uncertainty = half_width(uncertainty, zero=False)
    if not isinstance(uncertainty, Uncertainty):
        level = half = uncertainty
        uncertainty = uniform_uncertainty(case.scenario, half, half)
    flown = {
        name: dataclasses.replace(
            loop,
            scenario=dataclasses.replace(
                uncertainty.scenario,
                reference=loop.scenario.reference,
                specification=case.scenario.specification,
            ),
        )
        for name, loop in named.items()
    }
    settings = CampaignSettings(
        scenario=title,
        plant=case.plant,
        dt=None,
        duration=None,
        precision=8 * case.scenario.clock.dt.dtype.itemsize,
        seed=seed,
        members=members,
        design=design,
        uncertainty=level,
        gains=tuple(_gain_set(name, loop) for name, loop in flown.items()),
        until_ci=until_ci,
        digest=fingerprint([list(flown.values()), uncertainty]),
    )
    return Campaign(
        settings,
        uncertainty,
        make_sampler(settings, uncertainty.names()),
        tuple(flown.values()),
        tuple(name_of(loop.controller) for loop in flown.values()),
    )


def _gain_set(name: str, loop: ClosedLoop) -> GainSet:
    """Entry of the manifest for a loop: its gains, if its law has a name in files."""
    try:
        return GainSet(name, "Python", encode_law(loop))
    except ValueError:
        return GainSet(name, "Python", {})


def _rules(asked: Sequence[str], campaign: Campaign) -> list[Requirement]:
    """Requirements, read and found to be of this campaign.

    Raises:
        ValueError: one cannot be read, or asks for what the campaign does not have.
    """
    try:
        rules = [requirement(text) for text in asked]
    except argparse.ArgumentTypeError as error:
        raise ValueError(f"require: {error}") from error
    for rule in rules:
        rule.check(campaign.labels, measures_of(flight=campaign.has_flight))
    return rules


def _check_same_scenario(
    first: str, one: ClosedLoop, name: str, other: ClosedLoop
) -> None:
    """Refuse loops whose runs could not be compared.

    Raises:
        ValueError: names the part in which they differ.
    """
    for part in (
        "clock",
        "plant",
        "actuators",
        "disturbance",
        "initial_state",
        "water",
    ):
        mine, theirs = (getattr(loop.scenario, part) for loop in (one, other))
        if not eqx.tree_equal(mine, theirs):
            raise ValueError(
                f"all loops must fly one scenario; the {part} of {name!r} differs from "
                f"that of {first!r}."
            )
