"""The command that says what a flight record holds."""

import argparse

from jaxglider.files.writing import write_json
from jaxglider.plotting.save import save
from tuning.identification.record.overview import overview, text_of
from tuning.identification.record.reading import read_record
from tuning.identification.report.record_figure import record_figure
from tuning.reporting.console import note, print_result
from tuning.reporting.exit_codes import OK
from tuning.reporting.output_folder import folder_name


def record(options: argparse.Namespace) -> int:
    """`jaxglider record`: channels, findings, and what is missing for which fit."""
    flight = read_record(options.files, options.flip)
    content = overview(flight)
    print_result(content, text_of(content), as_json=options.json)
    write_json(options.out / "record.json", content)
    save(record_figure(flight), options.out / "record.png")
    note(f"{folder_name(options.out)}: record.json and record.png.")
    return OK
