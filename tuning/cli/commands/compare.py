"""The command that compares controllers under one sea, in a case or a mission."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from jaxglider import paper
from jaxglider.files.mission import load_mission
from jaxglider.paper.tuned import has_tuned_gains
from tuning.evaluation.runs import PlannedRun, report_runs, run_all
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


def compare(options: argparse.Namespace) -> int:
    """`jaxglider compare`: the paper's cases or a mission, all under the same sea."""
    if options.config is not None:
        return _compare_mission(options)
    scenarios = paper.SCENARIOS if options.scenario == "all" else (options.scenario,)
    files = read_files(options.gains)
    entries = [e for s in scenarios for e in _paper_entries(options, s, files)]
    for path, tables in files.items():
        _note_origin(path, tables, scenarios, options.plant)
    done, interrupted = run_all(entries, seed=0)
    return report_runs(options, done, interrupted, seed=0)


def _compare_mission(options: argparse.Namespace) -> int:
    """A mission flown by each law with the gains that it begins with, and by files.

    The mission's own law flies with the mission's gains.
    """
    mission = load_mission(options.config)
    case = FlightCase.of_mission(mission)
    kinds = [kind for kind in options.controllers if kind != mission.controller]
    words = [word for word in options.gains if word != TUNED]
    sets = case.resolve([MISSION, *([PAPER] if kinds else []), *words], kinds)
    entries = [
        PlannedRun(mission.name, mission.plant, one.label, case.loop(one)[1], False)
        for one in sets
    ]
    done, interrupted = run_all(entries, seed=mission.seed)
    return report_runs(options, done, interrupted, seed=mission.seed)


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
        scenario, options.plant, dt=options.dt or DT, actuators=options.actuators
    )
    model = paper.design_model(setting.plant)
    words = [PAPER, *(word for word in options.gains if word != TUNED)]
    sets = resolve(words, options.controllers, scenario, options.plant, files=files)
    if TUNED in options.gains:
        sets += _tuned_sets(options, scenario)
    for gains in sets:
        law = gains.load(scenario, model)
        yield PlannedRun(scenario, options.plant, gains.label, law.on(setting))


def _tuned_sets(options: argparse.Namespace, scenario: str) -> tuple[GainSet, ...]:
    """The gains that come along for this case; those that do not are named.

    Raises:
        ValueError: none of the laws has any.
    """
    plant = options.plant
    known = [k for k in options.controllers if has_tuned_gains(scenario, plant, k)]
    missing = [k for k in options.controllers if k not in known]
    if known and missing:
        note(
            f"no tuned gains come along for {', '.join(missing)} in {scenario} on "
            f"{plant}: they fly with those they begin with alone."
        )
    return resolve([TUNED], known or options.controllers, scenario, plant)
