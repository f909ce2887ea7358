"""The command that sweeps: run what is not yet run, then say what it comes to."""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

from jaxglider.io import provenance, write_json
from tuning.progress import Progress, note
from tuning.runs import check_writable, print_result
from tuning.sweep.campaign import draw, run_campaign
from tuning.sweep.columns import Table
from tuning.sweep.drivers import drivers
from tuning.sweep.engine import Engine
from tuning.sweep.levels import write_levels
from tuning.sweep.netcdf import write_members
from tuning.sweep.report import write_report
from tuning.sweep.settings import Campaign, build, read_settings
from tuning.sweep.store import Manifest, Store, StoreFull, opened, read_manifest
from tuning.sweep.summary import MEASURES, summarise, text_summary

OK, RUN_FAILED, VIOLATED, INTERRUPTED = 0, 1, 3, 130


def sweep(options: argparse.Namespace) -> int:
    """`jaxglider sweep`: a campaign for each level of uncertainty."""
    levels = list(dict.fromkeys(options.uncertainty))
    if options.until_ci is not None and options.shard != (1, 1):
        raise ValueError(
            "--until-ci does not go with --shard: no part knows what the others have "
            "found. Give --members instead."
        )
    campaigns = {level: build(read_settings(options, level)) for level in levels}
    for rule in options.require:
        rule.check(campaigns[levels[0]].labels, MEASURES)
    codes: list[int] = []
    summaries: dict[str, dict[str, Any]] = {}
    for level, campaign in campaigns.items():
        folder = options.out if len(levels) == 1 else options.out / _name(level)
        code, summary = _run(options, campaign, folder)
        codes.append(code)
        if summary:
            summaries[folder.name] = summary
        if code in (INTERRUPTED, RUN_FAILED):
            break
    if summaries:
        found = list(summaries.values())
        result = found[0] if len(levels) == 1 else {"levels": found}
        text = "\n\n".join(text_summary(summary) for summary in found)
        print_result(result, text, as_json=options.json)
    if len(summaries) > 1:
        write_levels(options.out, summaries, draws=not options.no_report)
    worst = [code for code in (INTERRUPTED, RUN_FAILED, VIOLATED) if code in codes]
    return worst[0] if worst else OK


def _name(level: float | Path) -> str:
    return level.stem if isinstance(level, Path) else f"uncertainty-{level:g}"


def _run(
    options: argparse.Namespace, campaign: Campaign, folder: Path
) -> tuple[int, dict[str, Any] | None]:
    """One campaign, or a part of it, and what came of it."""
    check_writable(folder)
    about = provenance(command=sys.argv[1:], precision=options.precision)
    number, parts = options.shard
    total = campaign.settings.members
    first, last = total * (number - 1) // parts, total * number // parts
    manifest = Manifest.of(campaign, first, last, about)
    _prepare(folder, manifest, resume=options.resume, overwrite=options.overwrite)
    code, begun = OK, time.monotonic()
    with opened(folder, manifest.row_type(), first) as store:
        if store.cut:
            note(
                f"{store.path}: cut off {store.cut} bytes of a row that was not whole."
            )
        try:
            _fill(campaign, store, first, last)
        except KeyboardInterrupt:
            note(f"interrupted; {store.count} members are safe (go on with --resume).")
            code = INTERRUPTED
        except StoreFull as error:
            note(str(error))
            return RUN_FAILED, None
        if store.count == 0:
            return code, None
        about |= {
            "seconds": round(time.monotonic() - begun, 1),
            "partial": code != OK,
            "shard": f"{number}/{parts}",
        }
        rows = store.rows()
        summary = conclude(options, folder, campaign, manifest, rows, about)
    return code or verdict(summary), summary


def verdict(summary: dict[str, Any]) -> int:
    """The exit code that follows from the requirements."""
    broken = any(entry["verdict"] != "met" for entry in summary["requirements"])
    return VIOLATED if broken else OK


def _prepare(
    folder: Path, manifest: Manifest, *, resume: bool, overwrite: bool
) -> None:
    """See that the folder holds this campaign or none.

    Raises:
        ValueError: it holds another one, or this one and it is not to be gone on with.
    """
    if (folder / "campaign.json").exists() and not overwrite:
        if not resume:
            raise ValueError(
                f"--out {folder} holds a campaign; go on with it by --resume, discard "
                "it by --overwrite, or give another folder."
            )
        kept = read_manifest(folder)
        same_part = (kept.first, kept.last) == (manifest.first, manifest.last)
        if kept.settings != manifest.settings or not same_part:
            raise ValueError(
                f"--resume: {folder} holds a campaign with other options "
                f"({', '.join(_differences(kept, manifest))}); repeat those, or give "
                "another folder."
            )
        for key in ("versions", "hardware"):
            if kept.about[key] != manifest.about[key]:
                note(
                    f"{folder} was begun with other {key}: new rows may differ from "
                    "the old ones in their last bits."
                )
        return
    (folder / "rows.bin").unlink(missing_ok=True)
    manifest.write(folder)


def _differences(kept: Manifest, wanted: Manifest) -> list[str]:
    names = [
        name
        for name, value in vars(kept.settings).items()
        if value != getattr(wanted.settings, name)
    ]
    parts = (kept.first, kept.last) != (wanted.first, wanted.last)
    return [*names, "shard"] if parts and "members" not in names else names


def _fill(campaign: Campaign, store: Store, first: int, last: int) -> None:
    progress, total, done_before = Progress(), last - first, store.count
    begun = [time.monotonic()]

    def engine() -> Engine:
        progress.show("compiling ...")
        made = Engine(campaign.loops, draw(campaign, first, 1)[1])
        begun[0] = time.monotonic()
        progress.show(f"{store.count}/{total} members")
        return made

    def show(count: int) -> None:
        rate = (time.monotonic() - begun[0]) / (count - done_before)
        left = rate * (total - count)
        progress.show(f"{count}/{total} members, at most {left:.0f} s left")

    try:
        run_campaign(campaign, engine, store, first, last, show)
    finally:
        progress.clear()


def conclude(
    options: argparse.Namespace,
    folder: Path,
    campaign: Campaign,
    manifest: Manifest,
    rows: Any,
    about: dict[str, Any],
) -> dict[str, Any]:
    """Write everything that follows from the rows, and return the summary.

    Args:
        options: confidence, requirements, and whether there is to be a report.
        folder: of the campaign.
        campaign: the rows belong to.
        manifest: likewise.
        rows: of the campaign or of a part of it.
        about: provenance.
    """
    progress = Progress()
    progress.show(f"writing to {folder} ...")
    table = Table(rows, campaign.labels)
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
    summary["provenance"] = about
    write_json(folder / "summary.json", summary)
    write_members(folder / "members.nc", manifest, rows, about)
    if not options.no_report:
        progress.show(f"drawing into {folder} ...")
        write_report(folder, campaign, table, summary)
    progress.clear()
    report = ", report.md and figures" if not options.no_report else ""
    note(f"{folder}: {len(rows)} members; summary.json, members.nc{report}.")
    return summary
