"""What follows from a campaign's rows, written."""

import argparse
from pathlib import Path
from typing import Any

from jaxglider.files.writing import write_json
from tuning.campaign.analysis.rank_correlations import drivers
from tuning.campaign.analysis.sensitivity import sensitivities
from tuning.campaign.analysis.summary import summarise
from tuning.campaign.report.report import write_campaign_report
from tuning.campaign.run.campaign import Campaign
from tuning.campaign.run.netcdf import write_members
from tuning.campaign.run.rows import Rows
from tuning.campaign.run.store import Manifest
from tuning.reporting.console import Progress, note
from tuning.reporting.exit_codes import OK, VIOLATED


def exit_code(summary: dict[str, Any]) -> int:
    """The exit code that follows from the requirements."""
    broken = any(entry["verdict"] != "met" for entry in summary["requirements"])
    return VIOLATED if broken else OK


def conclude(
    options: argparse.Namespace,
    folder: Path,
    campaign: Campaign,
    manifest: Manifest,
    rows: Any,
    about: dict[str, Any],
    runs: Rows | None = None,
) -> dict[str, Any]:
    """Write everything that follows from the rows, and return the summary.

    Args:
        options: confidence, requirements, and whether there is to be a report.
        folder: of the campaign.
        campaign: the rows belong to.
        manifest: likewise.
        rows: of the campaign or of a part of it.
        about: provenance.
        runs: for Sobol indices, or None for no sensitivities.
    """
    progress = Progress()
    progress.show(f"writing to {folder} ...")
    table = Rows(rows, campaign.labels)
    summary = summarise(
        campaign.settings, table, campaign.kinds, campaign.waypoints, options.confidence
    )
    summary["requirements"] = [
        entry
        for rule in options.require
        for entry in rule.judged(summary["controllers"])
    ]
    names = campaign.uncertainty.names()
    for number, found in enumerate(summary["controllers"].values()):
        found["rank_correlations"] = drivers(table, names, number)
    if runs is not None:
        progress.show("differentiating ...")
        sensitivities(campaign, options.sensitivity, table, runs, summary)
    summary["provenance"] = about
    write_json(folder / "summary.json", summary)
    write_members(folder / "members.nc", manifest, rows, about)
    if not options.no_report:
        progress.show(f"drawing into {folder} ...")
        write_campaign_report(folder, campaign, table, summary)
    progress.clear()
    report = ", report.md and figures" if not options.no_report else ""
    note(f"{folder}: {len(rows)} members; summary.json, members.nc{report}.")
    return summary
