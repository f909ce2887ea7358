"""The command that says how far gradients can be trusted."""

import argparse
import sys

from jaxglider.files.writing import provenance
from tuning.api.check_gradients import check_problem
from tuning.cli.session.from_options import nominal_spec
from tuning.reporting.console import Progress, print_result
from tuning.reporting.exit_codes import OK


def check(options: argparse.Namespace) -> int:
    """`jaxglider check-gradients`: reverse mode against differences, gain by gain."""
    outcome = check_problem(
        nominal_spec(options), short=options.short, progress=Progress()
    )
    about = provenance(command=sys.argv[1:], precision=options.precision)
    content = {**outcome.to_dict(), "provenance": about}
    print_result(content, str(outcome), as_json=options.json)
    return OK
