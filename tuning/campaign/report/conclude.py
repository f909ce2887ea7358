"""Conclusions from a campaign's rows, written to files."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jaxglider.files.writing import write_json
from tuning.campaign.analysis.rank_correlations import drivers
from tuning.campaign.analysis.requirements import Requirement
from tuning.campaign.analysis.sensitivity import sensitivities
from tuning.campaign.analysis.specified import specified_part
from tuning.campaign.analysis.summary import CampaignSummary, summarise
from tuning.campaign.report.report import write_campaign_report
from tuning.campaign.run.campaign import Campaign
from tuning.campaign.run.netcdf import write_members
from tuning.campaign.run.rows import Rows
from tuning.campaign.run.store import Manifest
from tuning.reporting.console import Progress, SilentProgress, note
from tuning.reporting.exit_codes import OK, VIOLATED


def exit_code(summary: CampaignSummary) -> int:
    """The exit code that follows from the requirements."""
    broken = any(entry["verdict"] != "met" for entry in summary.requirements)
    return VIOLATED if broken else OK


@dataclasses.dataclass(frozen=True)
class Conclusions:
    """Choice of the conclusions to draw from the rows of a campaign.

    Attributes:
        confidence: level of all intervals, in (0, 1).
        requirements: requirements that are judged.
        sensitivity: number of blocks for Sobol indices; 0 for rank correlations alone.
        report: whether report.md and figures are written.
    """

    confidence: float = 0.95
    requirements: Sequence[Requirement] = ()
    sensitivity: int = 0
    report: bool = True


def conclude(
    conclusions: Conclusions,
    campaign: Campaign,
    rows: Any,
    about: dict[str, Any],
    blocks: Rows | None = None,
    progress: Progress | None = None,
) -> CampaignSummary:
    """The summary of a campaign or of a part of it.

    Args:
        conclusions: choice of the report and of the sensitivities.
        campaign: campaign that the rows belong to.
        rows: rows of the campaign or of a part of it.
        about: provenance.
        blocks: rows for Sobol indices, or None for no sensitivities.
        progress: line that shows how far it is; none by default.
    """
    table, kinds = Rows(rows, campaign.labels), campaign.kinds
    summary = summarise(
        campaign.settings,
        table,
        kinds,
        campaign.waypoints,
        conclusions.confidence,
    )
    level = conclusions.confidence
    specified = [specified_part(campaign, table, n, level) for n in range(len(kinds))]
    names = campaign.uncertainty.names()
    correlations = [drivers(table, names, n) for n in range(len(summary.controllers))]
    answers: list[dict[str, Any] | None] = [None] * len(correlations)
    if blocks is not None:
        if progress:
            progress.show("differentiating ...")
        answers = sensitivities(
            campaign, conclusions.sensitivity, table, blocks, correlations
        )
    controllers = {
        label: dataclasses.replace(
            controller, rank_correlations=ranked, sensitivity=answer, **part
        )
        for (label, controller), ranked, answer, part in zip(
            summary.controllers.items(), correlations, answers, specified, strict=True
        )
    }
    requirements = [
        entry for rule in conclusions.requirements for entry in rule.judged(controllers)
    ]
    return dataclasses.replace(
        summary, controllers=controllers, requirements=requirements, provenance=about
    )


def write_conclusions(
    folder: Path,
    campaign: Campaign,
    manifest: Manifest,
    rows: Any,
    summary: CampaignSummary,
    *,
    report: bool,
    progress: Progress | None = None,
) -> None:
    """Write summary.json, members.nc and, if asked for, the report with its figures.

    Args:
        folder: folder of the campaign.
        campaign: campaign that the rows belong to.
        manifest: manifest of the campaign or of a part of it.
        rows: rows of the campaign or of a part of it.
        summary: summary of the rows.
        report: whether there is to be a report.
        progress: line that shows how far it is; none by default.

    Raises:
        OSError: the folder cannot be written.
    """
    progress = progress or SilentProgress()
    progress.show(f"writing to {folder} ...")
    write_json(folder / "summary.json", summary.to_dict())
    write_members(folder / "members.nc", manifest, rows, summary.provenance)
    if report:
        progress.show(f"drawing into {folder} ...")
        write_campaign_report(folder, campaign, Rows(rows, campaign.labels), summary)
    progress.clear()
    pages = ", report.md, figures and report.html" if report else ""
    note(f"{folder}: {len(rows)} members; summary.json, members.nc{pages}.")
