"""The command that sweeps: run what is not yet run, then say what it comes to."""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

from jaxglider.files.writing import provenance
from tuning.campaign.analysis.sensitivity import run_blocks
from tuning.campaign.analysis.summary import MEASURES, text_summary
from tuning.campaign.report.conclude import conclude, exit_code
from tuning.campaign.report.levels import write_levels
from tuning.campaign.run.campaign import Campaign, build, read_settings
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
from tuning.reporting.console import Progress, check_writable, note, print_result
from tuning.reporting.exit_codes import INTERRUPTED, OK, RUN_FAILED, VIOLATED


def sweep(options: argparse.Namespace) -> int:
    """`jaxglider sweep`: a campaign for each level of uncertainty."""
    levels = list(dict.fromkeys(options.uncertainty))
    _check(options)
    campaigns = {level: build(read_settings(options, level)) for level in levels}
    for rule in options.require:
        rule.check(campaigns[levels[0]].labels, MEASURES)
    codes: list[int] = []
    summaries: dict[str, dict[str, Any]] = {}
    for level, campaign in campaigns.items():
        folder = options.out if len(levels) == 1 else options.out / _name(level)
        run = _run if options.hosts == 1 else _run_on_hosts
        code, summary = run(options, campaign, folder)
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


def _check(options: argparse.Namespace) -> None:
    """Refuse options that do not go together.

    Raises:
        ValueError: names them.
    """
    if options.hosts > 1 and options.shard != (1, 1):
        raise ValueError(
            "--hosts does not go with --shard: each host runs a part already."
        )
    divided = "--shard" if options.shard != (1, 1) else "--hosts"
    whole = options.shard == (1, 1) and options.hosts == 1
    if options.until_ci is not None and not whole:
        raise ValueError(
            f"--until-ci does not go with {divided}: no part knows what the others "
            "have found. Give --members instead."
        )
    if options.sensitivity and not whole:
        raise ValueError(
            f"--sensitivity does not go with {divided}; ask for it where all members "
            "are."
        )


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
    prepare(folder, manifest, resume=options.resume, overwrite=options.overwrite)
    code, begun, work = OK, time.monotonic(), _Work(campaign)
    runs: Rows | None = None
    with opened(folder, manifest.row_type(), first) as store:
        if store.cut:
            note(
                f"{store.path}: cut off {store.cut} bytes of a row that was not whole."
            )
        try:
            work.fill(store, first, last)
            if options.sensitivity:
                runs = work.blocks(
                    folder / "sobol.bin", manifest.row_type(), options.sensitivity
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
            summary = conclude(options, folder, campaign, manifest, rows, about, runs)
        except OSError as error:
            note(
                f"{folder}: results cannot be written ({error}); {len(rows)} members "
                "are safe. Make room and go on with --resume."
            )
            return RUN_FAILED, None
    return code or exit_code(summary), summary


def _run_on_hosts(
    options: argparse.Namespace, campaign: Campaign, folder: Path
) -> tuple[int, dict[str, Any] | None]:
    """This host's part of a campaign; host 0 then gathers and concludes."""
    host, hosts, total = options.host, options.hosts, campaign.settings.members
    own = folder / f"host-{host}"
    alone = {"shard": (host + 1, hosts), "no_report": True, "require": []}
    mine = argparse.Namespace(**{**vars(options), **alone})
    code, _ = _run(mine, campaign, own)
    if code != OK:
        return code, None
    about = provenance(command=sys.argv[1:], precision=options.precision, hosts=hosts)
    merged = Manifest.of(campaign, 0, total, about)
    rows = read_rows(own / "rows.bin", merged.row_type())
    if host > 0:
        for _ in gathered(rows, total, host, hosts):
            pass
        return OK, None
    (folder / "rows.bin").unlink(missing_ok=True)
    merged.write(folder)
    with opened(folder, merged.row_type(), 0) as store:
        for part in gathered(rows, total, host, hosts):
            store.append(part)
        summary = conclude(options, folder, campaign, merged, store.rows(), about)
    return exit_code(summary), summary


class _Work:
    """The engine of a campaign, made when first needed, and how far the work is."""

    def __init__(self, campaign: Campaign) -> None:
        self._campaign = campaign
        self._engine: Engine | None = None
        self._progress = Progress()
        self._begun = time.monotonic()

    def engine(self) -> Engine:
        """The engine."""
        if self._engine is None:
            self._progress.show("compiling ...")
            example = draw(self._campaign, 0, 1)[1]
            self._engine = Engine(self._campaign.loops, example)
            self._progress.show("running ...")
        self._begun = time.monotonic()
        return self._engine

    def fill(self, store: Store, first: int, last: int) -> None:
        """Run what is missing of the members."""
        before, total = store.count, last - first

        def engine() -> Engine:
            made = self.engine()
            if before and not continues(self._campaign, made, store, first):
                note(
                    f"{store.path}: its last row comes out differently here and now "
                    "(other code, versions or hardware), so new rows will not quite "
                    "match the old ones; --overwrite makes all anew."
                )
            return made

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
        self._progress.show(f"{count}/{total} {what}, at most {left:.0f} s left")
