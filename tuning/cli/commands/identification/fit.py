"""The command that fits a vehicle to its flight record."""

import argparse
import sys

from tuning.api.fit import fit as fit_record
from tuning.identification.record.reading import read_record
from tuning.identification.report.report import text_of
from tuning.reporting.console import Progress, note, print_result
from tuning.reporting.exit_codes import OK
from tuning.reporting.output_folder import folder_name, keep_other_results


def fit(options: argparse.Namespace) -> int:
    """`jaxglider fit`: fit, judge on held-out dives, and write the files to go on."""
    keep_other_results(
        options.out / "fit.json", sys.argv[1:], overwrite=options.overwrite
    )
    progress = Progress()
    progress.show("reading the record ...")
    record = read_record(options.files, options.flip)
    progress.show("fitting ...")
    try:
        result = fit_record(
            record,
            options.vehicle,
            kind=options.kind,
            free=options.free,
            speed=not options.no_speed,
            mass=options.mass,
            volume=options.volume,
            held_out=options.held_out,
            worst=options.profile,
        )
    finally:
        progress.clear()
    content = result.save(options.out, command=sys.argv[1:])
    print_result(content, text_of(content), as_json=options.json)
    files = ", ".join([*content["files"], "fit.json", "figures"])
    note(f"{folder_name(options.out)}: {files}, report.md and report.html.")
    return OK
