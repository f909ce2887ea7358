"""The command that joins the shards of a campaign."""

import argparse
import sys

from jaxglider.files.writing import provenance
from tuning.campaign.analysis.summary import measures_of
from tuning.campaign.report.conclude import conclude, exit_code, write_conclusions
from tuning.campaign.report.text import text_summary
from tuning.campaign.run.campaign import build
from tuning.campaign.run.shards import join, read_shards
from tuning.campaign.run.store import (
    read_rows,
)
from tuning.cli.session.from_options import conclusions
from tuning.reporting.console import Progress, print_result


def merge(options: argparse.Namespace) -> int:
    """`jaxglider merge`: the rows of the whole campaign, byte for byte."""
    shards = read_shards(options.folders)
    for rule in options.require:
        rule.check(shards[0][1].labels, measures_of(flight=shards[0][1].has_flight))
    merged = join(shards, options.out, overwrite=options.overwrite)
    campaign = build(merged.settings)
    about = provenance(
        command=sys.argv[1:],
        precision=merged.settings.precision,
        shards=[manifest.about for _, manifest in shards],
    )
    rows = read_rows(options.out / "rows.bin", merged.row_type())
    summary = conclude(conclusions(options), campaign, rows, about)
    write_conclusions(
        options.out,
        campaign,
        merged,
        rows,
        summary,
        report=not options.no_report,
        progress=Progress(),
    )
    print_result(summary.to_dict(), text_summary(summary), as_json=options.json)
    return exit_code(summary)
