"""The command that sweeps: run what is not yet run, then say what it comes to."""

import argparse
import sys
from pathlib import Path

from tuning.campaign.analysis.summary import (
    CampaignSummary,
    measures_of,
    text_summary,
)
from tuning.campaign.execute import Execution, execute, execute_on_hosts
from tuning.campaign.report.levels import folder_names, named, write_levels
from tuning.campaign.run.campaign import Campaign, build
from tuning.cli.session.from_options import (
    campaign_settings,
    conclusions,
    gains_words,
    note_needless_controller,
)
from tuning.reporting.console import Progress, print_result
from tuning.reporting.exit_codes import INTERRUPTED, OK, RUN_FAILED, VIOLATED


def sweep(options: argparse.Namespace) -> int:
    """`jaxglider sweep`: a campaign for each level of uncertainty."""
    levels = list(dict.fromkeys(options.uncertainty))
    _check(options)
    note_needless_controller(gains_words(options), options.controller)
    names = folder_names(levels)
    campaigns = {level: build(campaign_settings(options, level)) for level in levels}
    for rule in options.require:
        rule.check(
            campaigns[levels[0]].labels,
            measures_of(flight=campaigns[levels[0]].has_flight),
        )
    codes: list[int] = []
    summaries: dict[str, CampaignSummary] = {}
    for level, campaign in campaigns.items():
        folder = options.out if len(levels) == 1 else options.out / names[level]
        code, summary = _execute(options, campaign, folder)
        codes.append(code)
        if summary:
            summaries[folder.name] = summary
        if code in (INTERRUPTED, RUN_FAILED):
            break
    if summaries:
        texts = {name: text_summary(summary) for name, summary in summaries.items()}
        if len(levels) == 1:
            (alone,) = summaries.values()
            result = alone.to_dict()
        else:
            result = {"levels": named(summaries)}
            texts = {name: f"{name}: {text}" for name, text in texts.items()}
        print_result(result, "\n\n".join(texts.values()), as_json=options.json)
    if len(summaries) > 1:
        write_levels(options.out, summaries, draws=not options.no_report)
    worst = [code for code in (INTERRUPTED, RUN_FAILED, VIOLATED) if code in codes]
    return worst[0] if worst else OK


def _execute(
    options: argparse.Namespace, campaign: Campaign, folder: Path
) -> tuple[int, CampaignSummary | None]:
    execution = Execution(
        options.shard, options.resume, options.overwrite, sys.argv[1:]
    )
    rest = execution, conclusions(options), Progress()
    if options.hosts == 1:
        return execute(campaign, folder, *rest)
    return execute_on_hosts(campaign, folder, (options.host, options.hosts), *rest)


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
