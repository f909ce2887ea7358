"""The command that tunes: descend, choose on members not descended on, report."""

import argparse
import sys

from tuning.api.tune import solve
from tuning.cli.session.from_options import (
    black_box_settings,
    descent_settings,
    problem_spec,
)
from tuning.evaluation.report import text_report
from tuning.reporting.console import Progress, note, print_result
from tuning.reporting.exit_codes import INTERRUPTED, OK
from tuning.reporting.output_folder import folder_name


def tune(options: argparse.Namespace) -> int:
    """`jaxglider tune`: gradient descent through the rollout."""
    result = solve(
        problem_spec(options),
        descent_settings(options),
        black_box_settings(options),
        out=options.out,
        resume=options.resume,
        check=not options.no_check,
        progress=Progress(),
    )
    mission = None if options.config is None else str(options.config)
    content = result.save(options.out, command=sys.argv[1:], mission=mission)
    print_result(content, text_report(content), as_json=options.json)
    note(
        f"{folder_name(options.out)}: gains.toml, history.csv, tune.json and report.md."
    )
    return INTERRUPTED if result.interrupted else OK
