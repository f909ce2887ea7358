"""A campaign from its first member to its report, in one folder."""

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jaxglider.core.toml import reason
from jaxglider.files.writing import provenance
from tuning.campaign.analysis.sensitivity import run_blocks
from tuning.campaign.analysis.summary import CampaignSummary
from tuning.campaign.report.conclude import (
    Conclusions,
    conclude,
    exit_code,
    write_conclusions,
)
from tuning.campaign.run.campaign import Campaign
from tuning.campaign.run.engine import Engine
from tuning.campaign.run.hosts import gathered
from tuning.campaign.run.loop import continues, draw, run_campaign
from tuning.campaign.run.rows import Rows
from tuning.campaign.run.store import (
    Manifest,
    Store,
    StoreFull,
    opened,
    prepare,
    read_rows,
)
from tuning.reporting.console import Progress, note
from tuning.reporting.exit_codes import INTERRUPTED, OK, RUN_FAILED
from tuning.reporting.output_folder import writing_to


@dataclasses.dataclass(frozen=True)
class Execution:
    """Part of a campaign to run, and the fate of an older one.

    Attributes:
        shard: number of the part, from 1, and number of parts.
        resume: whether to go on with the campaign in the folder.
        overwrite: whether to discard the campaign in the folder.
        command: words of the command line, for provenance.
    """

    shard: tuple[int, int] = (1, 1)
    resume: bool = False
    overwrite: bool = False
    command: Sequence[str] = ()


def execute(
    campaign: Campaign,
    folder: Path,
    execution: Execution,
    conclusions: Conclusions,
    progress: Progress,
) -> tuple[int, CampaignSummary | None]:
    """Run what is missing of a campaign, or of a part of it, and say what it comes to.

    Args:
        campaign: campaign to run.
        folder: folder of its rows and results.
        execution: part to run, and what becomes of an older campaign.
        conclusions: choice of the report and of the sensitivities.
        progress: line that shows how far it is.

    Returns:
        An exit code, and the summary; None without a row.

    Raises:
        ValueError: the folder holds another campaign, or another process writes it.
        OSError: the folder cannot be written.
    """
    with writing_to(folder):
        return _execute(campaign, folder, execution, conclusions, progress)


def _execute(
    campaign: Campaign,
    folder: Path,
    execution: Execution,
    conclusions: Conclusions,
    progress: Progress,
) -> tuple[int, CampaignSummary | None]:
    about = provenance(
        command=list(execution.command), precision=campaign.settings.precision
    )
    number, parts = execution.shard
    total = campaign.settings.members
    first, last = total * (number - 1) // parts, total * number // parts
    manifest = Manifest.of(campaign, first, last, about)
    prepare(folder, manifest, resume=execution.resume, overwrite=execution.overwrite)
    code, begun, work = OK, time.monotonic(), Work(campaign, progress)
    blocks: Rows | None = None
    with opened(folder, manifest.row_type(), first) as store:
        if store.cut:
            note(
                f"{store.path}: cut off {store.cut} bytes of a row that was not whole."
            )
        try:
            work.fill(store, first, last)
            if conclusions.sensitivity:
                blocks = work.blocks(
                    folder / "sobol.bin", manifest.row_type(), conclusions.sensitivity
                )
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
        try:
            summary = conclude(conclusions, campaign, rows, about, blocks, progress)
            write_conclusions(
                folder,
                campaign,
                manifest,
                rows,
                summary,
                report=conclusions.report,
                progress=progress,
            )
        except OSError as error:
            note(
                f"{folder}: results cannot be written ({reason(error)}); {len(rows)} "
                "members are safe. Make room and go on with --resume."
            )
            return RUN_FAILED, None
    return code or exit_code(summary), summary


def execute_on_hosts(
    campaign: Campaign,
    folder: Path,
    host: tuple[int, int],
    execution: Execution,
    conclusions: Conclusions,
    progress: Progress,
) -> tuple[int, CampaignSummary | None]:
    """Run this host's part of a campaign; host 0 then gathers and concludes.

    Args:
        campaign: campaign to run, the same on every host.
        folder: folder of the whole campaign.
        host: number of this host, from 0, and number of hosts.
        execution: part of the campaign to run, and fate of an older one.
        conclusions: choice of the report and of the sensitivities.
        progress: line that shows how far it is.

    Returns:
        An exit code, and on host 0 the summary.
    """
    number, hosts = host
    total, own = campaign.settings.members, folder / f"host-{number}"
    code, _ = execute(
        campaign,
        own,
        dataclasses.replace(execution, shard=(number + 1, hosts)),
        dataclasses.replace(conclusions, requirements=(), report=False),
        progress,
    )
    if code != OK:
        return code, None
    about = provenance(
        command=list(execution.command),
        precision=campaign.settings.precision,
        hosts=hosts,
    )
    merged = Manifest.of(campaign, 0, total, about)
    rows = read_rows(own / "rows.bin", merged.row_type())
    if number > 0:
        for _ in gathered(rows, total, number, hosts):
            pass
        return OK, None
    (folder / "rows.bin").unlink(missing_ok=True)
    merged.write(folder)
    with opened(folder, merged.row_type(), 0) as store:
        for part in gathered(rows, total, number, hosts):
            store.append(part)
        summary = conclude(conclusions, campaign, store.rows(), about)
        write_conclusions(
            folder,
            campaign,
            merged,
            store.rows(),
            summary,
            report=conclusions.report,
            progress=progress,
        )
    return exit_code(summary), summary


class Work:
    """The engine of a campaign, made when first needed, and how far the work is."""

    def __init__(self, campaign: Campaign, progress: Progress) -> None:
        self._campaign = campaign
        self._engine: Engine | None = None
        self._progress = progress
        self._begun = time.monotonic()

    def engine(self) -> Engine:
        """The engine."""
        if self._engine is None:
            self._progress.show("compiling ...")
            example = draw(self._campaign, 0, 1)[1]
            self._engine = Engine(
                self._campaign.loops, example, members=self._campaign.settings.members
            )
            self._progress.show("running ...")
        self._begun = time.monotonic()
        return self._engine

    def fill(self, store: Store, first: int, last: int) -> None:
        """Run what is missing of the members."""
        before, total = store.count, last - first

        def engine() -> Engine:
            ready = self.engine()
            if before and not continues(self._campaign, ready, store, first):
                note(
                    f"{store.path}: its last row comes out differently here and now "
                    "(other code, versions or hardware), so new rows will not quite "
                    "match the old ones; --overwrite makes all anew."
                )
            return ready

        try:
            run_campaign(
                self._campaign,
                engine,
                store,
                first,
                last,
                lambda count: self._show("members", count, total, before),
            )
        finally:
            self._progress.clear()

    def blocks(self, path: Path, kind: Any, blocks: int) -> Rows:
        """Run what is missing of the blocks for Sobol indices."""
        before: list[int] = []

        def show(count: int, total: int) -> None:
            before.append(count)
            self._show("runs for Sobol indices", count, total, before[0] - 1)

        try:
            return run_blocks(self._campaign, blocks, self.engine, path, kind, show)
        finally:
            self._progress.clear()

    def _show(self, what: str, count: int, total: int, before: int) -> None:
        rate = (time.monotonic() - self._begun) / max(count - before, 1)
        left = rate * (total - count)
        self._progress.show(
            f"{count}/{total} {what}, at most {left:.0f} s left", count, total
        )
