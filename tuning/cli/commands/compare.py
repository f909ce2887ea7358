"""The command that compares controllers in the paper's cases under one sea."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from jaxglider import paper
from jaxglider.core.toml import read_toml
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.evaluation.runs import PlannedRun, report_runs, run_all
from tuning.problem.case import DT
from tuning.problem.gain_sets import PAPER, resolve
from tuning.reporting.console import note


def compare(options: argparse.Namespace) -> int:
    """`jaxglider compare`: the paper's cases under the same sea."""
    scenarios = paper.SCENARIOS if options.scenario == "all" else (options.scenario,)
    entries = [e for s in scenarios for e in _paper_entries(options, s)]
    for path in dict.fromkeys(options.gains):
        if path.exists():
            _note_origin(path, scenarios, options.plant)
    done, interrupted = run_all(entries, seed=0)
    return report_runs(options, done, interrupted, seed=0)


def _note_origin(path: Path, scenarios: Sequence[str], plant: str) -> None:
    """Say so where gains meet another task than the one they were tuned for."""
    origin = read_toml(path).get("provenance", {})
    if not {"scenario", "plant"} <= set(origin):
        return
    if origin["plant"] != plant or set(scenarios) != {origin["scenario"]}:
        note(f"{path} was tuned for {origin['scenario']} on {origin['plant']}.")


def _paper_entries(options: argparse.Namespace, scenario: str) -> Iterator[PlannedRun]:
    setting = paper.make_scenario(scenario, options.plant, dt=options.dt or DT)
    model = paper.design_model(setting.plant)
    for name in dict.fromkeys(options.controllers):
        loop = ClosedLoop(
            setting,
            paper.make_controller(name, scenario, model),
            paper.make_observer(name, model),
        )
        yield PlannedRun(scenario, options.plant, name, loop)
    # The paper's own gains are compared anyhow.
    words = [str(path) for path in options.gains if str(path) != PAPER]
    for gains in resolve(words, options.controllers, scenario, options.plant):
        law = gains.load(scenario, model)
        yield PlannedRun(scenario, options.plant, gains.label, law.on(setting))
