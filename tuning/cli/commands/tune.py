"""The command that tunes: descend, choose on members not descended on, report."""

import argparse
import sys
from pathlib import Path

import tomli_w

from jaxglider.files.gains import encode_law
from jaxglider.files.writing import write_text
from tuning.api.tune import solve
from tuning.cli.session.from_options import (
    black_box_settings,
    descent_settings,
    note_mission,
    problem_spec,
)
from tuning.evaluation.beforehand import note_lost
from tuning.evaluation.report import text_report
from tuning.reporting.console import Progress, note, print_result
from tuning.reporting.exit_codes import INTERRUPTED, OK, RUN_FAILED
from tuning.reporting.output_folder import folder_name, keep_other_results
from tuning.search.rescue import CannotStart


def tune(options: argparse.Namespace) -> int:
    """`jaxglider tune`: gradient descent through the rollout."""
    keep_other_results(
        options.out / "tune.json", sys.argv[1:], overwrite=options.overwrite
    )
    spec = problem_spec(options)
    note_mission(options)
    if options.config is not None:
        note_lost(spec.loop, "at the start ")
    try:
        result = solve(
            spec,
            descent_settings(options),
            black_box_settings(options),
            adversarial=options.adversarial,
            out=options.out,
            resume=options.resume,
            check=not options.no_check,
            progress=Progress(),
        )
    except CannotStart as error:
        return _say_tried(options.out, error)
    mission = None if options.config is None else str(options.config)
    content = result.save(options.out, command=sys.argv[1:], mission=mission)
    note(
        f"{folder_name(options.out)}: gains.toml, history.csv, tune.json, report.md "
        "and report.html."
    )
    text = text_report(content, gains=options.verbose)
    print_result(content, text, as_json=options.json)
    return INTERRUPTED if result.interrupted else OK


def _say_tried(out: Path, error: CannotStart) -> int:
    """Say why there is nothing to tune from, and write the gains that were tried."""
    about = {"command": " ".join(["jaxglider", *sys.argv[1:]])}
    for number, loop in enumerate(error.tried, 1):
        tables = {**encode_law(loop, out), "provenance": about}
        write_text(out / f"tried-{number}.toml", tomli_w.dumps(tables))
    note(str(error))
    if error.tried:
        note(f"{folder_name(out)}: tried-1.toml to tried-{len(error.tried)}.toml.")
    return RUN_FAILED
