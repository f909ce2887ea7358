"""The command that compares controllers in the paper's cases under one sea."""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from jaxglider import paper
from jaxglider.files.mission import load_mission
from jaxglider.paper.tuned import has_tuned_gains
from jaxglider.vehicle.published import load_vehicle
from tuning.cli.options.arguments import PAPER_CONTROLLERS
from tuning.cli.session.from_options import refuse_beside_mission
from tuning.evaluation.beforehand import note_sense
from tuning.evaluation.runs import PlannedRun, report_runs, run_all
from tuning.evaluation.trajectory_tables import check_kind
from tuning.problem.case import DT, FlightCase
from tuning.problem.gain_sets import (
    MISSION,
    PAPER,
    TUNED,
    GainSet,
    read_files,
    resolve,
)
from tuning.reporting.console import note
from tuning.reporting.output_folder import keep_other_results
from tuning.reporting.tracks import check_plotly


def compare(options: argparse.Namespace) -> int:
    """`jaxglider compare`: the paper's cases, or a mission, under the same sea."""
    check_kind(options.table)
    if options.interactive:
        check_plotly()
    keep_other_results(
        options.out / "metrics.json", sys.argv[1:], overwrite=options.overwrite
    )
    if options.config is not None:
        return _compare_on_mission(options)
    options.plant = options.plant or "printed"
    whole = options.scenario in (None, "all")
    scenarios = paper.SCENARIOS if whole else (options.scenario,)
    files = read_files(options.gains)
    entries = [e for s in scenarios for e in _paper_entries(options, s, files)]
    for path, tables in files.items():
        _note_origin(path, tables, scenarios, options.plant)
    done, interrupted = run_all(entries, seed=0)
    return report_runs(options, done, interrupted, seed=0)


def _compare_on_mission(options: argparse.Namespace) -> int:
    """Some laws on one mission: its own, and those asked for with their first gains."""
    refuse_beside_mission(options)
    mission = load_mission(options.config)
    if mission.stand_ins:
        note(mission.stand_ins)
    case = FlightCase.of_mission(mission, options.duration)
    kinds = [k for k in options.controllers or [] if k != mission.controller]
    words = [word for word in options.gains if word != TUNED]
    sets = case.resolve([MISSION, *([PAPER] if kinds else []), *words], kinds)
    if TUNED in options.gains:
        sets += _tuned_for_mission([mission.controller, *kinds], case)
    entries = [
        PlannedRun(
            case.title, case.vehicle, case.plant, one.label, case.loop(one)[1], False
        )
        for one in sets
    ]
    note_sense(mission, mission.law.on(case.scenario))
    done, interrupted = run_all(entries, seed=mission.seed)
    return report_runs(options, done, interrupted, seed=mission.seed)


def _tuned_for_mission(kinds: Sequence[str], case: FlightCase) -> tuple[GainSet, ...]:
    """The gains that come along for this very mission; laws without any are named."""
    known = [k for k in kinds if has_tuned_gains(case.title, case.plant, k)]
    missing = [k for k in kinds if k not in known]
    if missing:
        note(
            f"no tuned gains come along for {', '.join(missing)} on {case.title}: they "
            "fly with those they begin with alone. `jaxglider tune` makes some."
        )
    return case.resolve([TUNED], known) if known else ()


def _note_origin(
    path: str, tables: Mapping[str, Any], scenarios: Sequence[str], plant: str
) -> None:
    """Say so where gains meet another task than the one they were tuned for."""
    origin = tables.get("provenance", {})
    if not {"scenario", "plant"} <= set(origin):
        return
    if origin["plant"] != plant or set(scenarios) != {origin["scenario"]}:
        note(f"{path} was tuned for {origin['scenario']} on {origin['plant']}.")


def _paper_entries(
    options: argparse.Namespace, scenario: str, files: Mapping[str, dict[str, Any]]
) -> Iterator[PlannedRun]:
    setting = paper.make_scenario(
        scenario,
        options.plant,
        dt=options.dt or DT,
        duration=options.duration,
        actuators=options.actuators,
    )
    model = paper.design_model(setting.plant)
    kinds = options.controllers or list(PAPER_CONTROLLERS)
    words = [PAPER, *(word for word in options.gains if word != TUNED)]
    sets = resolve(words, kinds, scenario, options.plant, files=files)
    if TUNED in options.gains:
        sets += _tuned_sets(kinds, scenario, options.plant)
    where = scenario, load_vehicle(paper.VEHICLE).name, options.plant
    for gains in sets:
        law = gains.load(scenario, model)
        yield PlannedRun(*where, gains.label, law.on(setting))


def _tuned_sets(kinds: Sequence[str], scenario: str, plant: str) -> tuple[GainSet, ...]:
    """The gains that come along for this case; those that do not are named.

    Raises:
        ValueError: none of the laws has any.
    """
    known = [k for k in kinds if has_tuned_gains(scenario, plant, k)]
    missing = [k for k in kinds if k not in known]
    if known and missing:
        note(
            f"no tuned gains come along for {', '.join(missing)} in {scenario} on "
            f"{plant}: they fly with those they begin with alone."
        )
    return resolve([TUNED], known or kinds, scenario, plant)
