"""The command that flies one mission, steered by its controller or by a program."""

import argparse
import dataclasses
import sys
from pathlib import Path

import numpy as np

from jaxglider.control.observer import NoObserver
from jaxglider.files.mission import Mission, load_mission
from jaxglider.files.records.og1 import identifier, write_og1
from jaxglider.files.records.og1_variables import refuse_nowhere
from jaxglider.files.writing import provenance
from jaxglider.onboard.guard import status_names
from jaxglider.onboard.pipe import ChildProcess, PipeController
from jaxglider.simulation.checks.start import start_warnings
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.evaluation.beforehand import note_sense, note_stability
from tuning.evaluation.runs import FinishedRun, PlannedRun, report_runs, run_all
from tuning.evaluation.trajectory_tables import check_kind
from tuning.problem.case import FlightCase
from tuning.problem.gain_sets import PAPER
from tuning.reporting.console import note
from tuning.reporting.exit_codes import RUN_FAILED
from tuning.reporting.output_folder import keep_other_results
from tuning.reporting.tracks import check_plotly


def simulate_mission(options: argparse.Namespace) -> int:
    """`jaxglider simulate`: one mission from a file.

    Raises:
        ValueError: no mission is named, or it cannot be used.
    """
    if options.config is None:
        raise ValueError(
            "a mission file is required: MISSION or --config FILE. `jaxglider init` "
            "writes one to start from, `jaxglider missions` lists some that fly."
        )
    check_kind(options.table)
    if options.interactive:
        check_plotly()
    keep_other_results(
        options.out / "metrics.json", sys.argv[1:], overwrite=options.overwrite
    )
    mission = load_mission(options.config)
    if options.og1:
        refuse_nowhere(mission.loop.scenario)
    if mission.stand_ins:
        note(mission.stand_ins)
    case, flown = FlightCase.of_mission(mission, options.duration), mission
    if options.duration is not None:
        loop = mission.law.on(case.scenario)
        flown = dataclasses.replace(mission, loop=loop)
    note_sense(mission, flown.loop)
    mission = flown
    seed = mission.seed if options.seed is None else options.seed
    if options.controller_binary is not None:
        return _simulate_outside(options, mission, seed)
    name, loop = mission.controller, mission.loop
    if options.controller is not None:
        (gains,) = case.resolve([PAPER], [options.controller])
        name, loop = gains.label, case.loop(gains)[1]
    for warning in start_warnings(loop):
        note(f"warning: {warning}")
    if options.stability:
        note_stability(loop)
    entry = _planned(mission, name, loop)
    done, interrupted = run_all([entry], seed=seed, keep_every=options.keep_every)
    code = report_runs(options, done, interrupted, seed)
    if options.og1 and done:
        _write_og1(options.out, mission, done[0])
    return code


def _write_og1(out: Path, mission: Mission, run: FinishedRun) -> None:
    """The flight in the form that the tools for real gliders read."""
    path = out / f"{identifier(mission.name, mission.start)}.nc"
    about = provenance(command=sys.argv[1:])
    scenario = run.entry.loop.scenario
    write_og1(path, run.trajectory, scenario, mission.name, mission.start, about)
    note(f"{path}: OG-1.0; `jaxglider record` reads it.")


def _planned(mission: Mission, name: str, loop: ClosedLoop) -> PlannedRun:
    """The run of a mission by the law of that name."""
    return PlannedRun(
        mission.name, mission.vehicle, mission.plant, name, loop, published=False
    )


def _simulate_outside(options: argparse.Namespace, mission: Mission, seed: int) -> int:
    """The same with a program in the place of controller and observer."""
    loop = mission.loop
    for warning in start_warnings(loop):
        note(f"warning: {warning}")
    # 0.05 in single precision is 0.05, not 0.05000000074505806, to a program.
    dt = float(str(np.asarray(loop.scenario.clock.dt)))
    peer = ChildProcess([options.controller_binary], dt, options.controller_timeout)
    try:
        outside = PipeController(
            loop.controller.funnel, peer, origin=loop.scenario.origin
        )
        loop = ClosedLoop(loop.scenario, outside, NoObserver(), loop.estimator)
        name = Path(options.controller_binary).name
        entry = _planned(mission, name, loop)
        done, interrupted = run_all([entry], seed=seed)
        if peer.failure is not None:
            note(f"{peer.failure} Nothing is written.")
            return RUN_FAILED
    finally:
        peer.close()
    for word, count in sorted(peer.statuses.items()):
        said = ", ".join(status_names(word)) or "unknown"
        note(f"status {word} on {count} ticks: {said}.")
    return report_runs(options, done, interrupted, seed)
