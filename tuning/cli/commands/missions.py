"""The command that lists the missions of the package."""

import argparse
import json
import sys

from jaxglider.files.flight.missions import mission_path, mission_summaries
from tuning.reporting.exit_codes import OK


_HINT = """`jaxglider simulate NAME` flies one; --mission NAME stands wherever --config
does; `jaxglider missions --show NAME` prints its file, to start one of your own."""


def missions(options: argparse.Namespace) -> int:
    """`jaxglider missions`: the missions of the package, or the file of one.

    Raises:
        ValueError: there is none of that name.
    """
    if options.show is not None:
        sys.stdout.write(mission_path(options.show).read_text(encoding="utf-8"))
        return OK
    found = mission_summaries()
    if options.json:
        sys.stdout.write(json.dumps(found, indent=2) + "\n")
        return OK
    wide = max(len(name) for name in found) + 2
    lines = [f"{'mission':<{wide}}{'vehicle':<15}{'law':<13}{'at most':<9}about"]
    for name, one in found.items():
        lines.append(
            f"{name:<{wide}}{one['vehicle']:<15}{one['controller']:<13}"
            f"{one['at_most']:<9}{one['about']}"
        )
    sys.stdout.write("\n".join(lines) + f"\n\n{_HINT}\n")
    return OK
