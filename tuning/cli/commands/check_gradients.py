"""The command that says how far gradients can be trusted."""

import argparse
import sys

from jaxglider.files.writing import provenance, write_json
from tuning.api.check_gradients import check_problem
from tuning.cli.session.from_options import nominal_spec, note_mission
from tuning.reporting.console import Progress, note, print_result
from tuning.reporting.exit_codes import OK
from tuning.reporting.html import write_html
from tuning.reporting.output_folder import folder_name, keep_other_results


def check(options: argparse.Namespace) -> int:
    """`jaxglider check-gradients`: reverse mode against differences, gain by gain."""
    if options.out is not None:
        keep_other_results(
            options.out / "gradients.json", sys.argv[1:], overwrite=options.overwrite
        )
    spec = nominal_spec(options)
    note_mission(options)
    outcome = check_problem(spec, short=options.short, progress=Progress())
    about = provenance(command=sys.argv[1:], precision=options.precision)
    content = {**outcome.to_dict(), "provenance": about}
    if options.out is not None:
        write_json(options.out / "gradients.json", content)
        title = f"{spec.case.headline}, {spec.controller}"
        text = f"# How far gradients can be trusted: {title}\n\n{outcome.markdown()}"
        write_html(options.out / "report.html", text, about)
        note(f"{folder_name(options.out)}: gradients.json and report.html.")
    print_result(content, str(outcome), as_json=options.json)
    return OK
