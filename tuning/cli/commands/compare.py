"""The command that compares controllers in the paper's cases under one sea."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from jaxglider import paper
from tuning.evaluation.runs import PlannedRun, report_runs, run_all
from tuning.problem.case import DT
from tuning.problem.gain_sets import PAPER, read_files, resolve
from tuning.reporting.console import note


def compare(options: argparse.Namespace) -> int:
    """`jaxglider compare`: the paper's cases under the same sea."""
    scenarios = paper.SCENARIOS if options.scenario == "all" else (options.scenario,)
    files = read_files(options.gains)
    entries = [e for s in scenarios for e in _paper_entries(options, s, files)]
    for path, tables in files.items():
        _note_origin(path, tables, scenarios, options.plant)
    done, interrupted = run_all(entries, seed=0)
    return report_runs(options, done, interrupted, seed=0)


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
    sets = resolve(
        [PAPER, *options.gains],
        options.controllers,
        scenario,
        options.plant,
        files=files,
    )
    for gains in sets:
        law = gains.load(scenario, model)
        yield PlannedRun(scenario, options.plant, gains.label, law.on(setting))
