"""The command that sweeps: run what is not yet run, then say what it comes to."""

import argparse
import contextlib
import dataclasses
import sys
from pathlib import Path
from typing import Any

from jaxglider.files.law_paths import short_name
from jaxglider.files.uncertainty import load_uncertainty
from jaxglider.files.writing import provenance
from tuning.api.worst import worst as find_worst_member
from tuning.campaign.analysis.bisection import find_threshold
from tuning.campaign.analysis.requirements import SPECIFICATION
from tuning.campaign.analysis.summary import CampaignSummary, measures_of
from tuning.campaign.execute import Execution, execute, execute_on_hosts
from tuning.campaign.report.levels import folder_names, named, write_levels
from tuning.campaign.report.text import text_summary
from tuning.campaign.run.campaign import Campaign, build
from tuning.cli.session.from_options import (
    campaign_settings,
    conclusions,
    flight_case,
    gains_words,
    note_mission,
    note_needless_controller,
    starting_loop,
)
from tuning.reporting.console import Progress, note, print_result
from tuning.reporting.exit_codes import INTERRUPTED, OK, RUN_FAILED, VIOLATED
from tuning.reporting.output_folder import (
    folder_name,
    keep_other_results,
    writing_to,
)

LEVELS = 32
"""Parts of the highest level: a bisection of these takes seven campaigns at most."""


def sweep(options: argparse.Namespace) -> int:
    """`jaxglider sweep`: a campaign for each level of uncertainty."""
    _check(options)
    if options.find_level:
        return _find_level(options)
    levels = list(dict.fromkeys(options.uncertainty))
    note_needless_controller(gains_words(options), options.controller)
    names = folder_names(levels)
    campaigns = {level: build(campaign_settings(options, level)) for level in levels}
    for rule in options.require:
        rule.check(
            campaigns[levels[0]].labels,
            measures_of(flight=campaigns[levels[0]].has_flight),
        )
    note_mission(options)
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
        write_levels(options.out, summaries, not options.no_report)
    worst = [code for code in (INTERRUPTED, RUN_FAILED, VIOLATED) if code in codes]
    return worst[0] if worst else OK


def worst(options: argparse.Namespace) -> int:
    """`jaxglider worst`: a search for the worst member, beside random ones."""
    keep_other_results(
        options.out / "worst.json", sys.argv[1:], overwrite=options.overwrite
    )
    case = flight_case(options)
    controller, loop = starting_loop(options, case)
    box: Any = options.uncertainty
    if isinstance(box, Path):
        box = load_uncertainty(box, loop.scenario)
    note_mission(options)
    with writing_to(options.out):
        result = find_worst_member(
            loop,
            uncertainty=box,
            budget=options.budget,
            random=options.random,
            seed=options.seed,
        )
        about = provenance(command=sys.argv[1:], precision=options.precision)
        content = result.save(
            options.out,
            scenario=case.title,
            plant=case.plant,
            controller=short_name(controller),
            provenance=about,
        )
    note(f"{folder_name(options.out)}: worst.json.")
    print_result(content, str(result), as_json=options.json)
    return OK


def _find_level(options: argparse.Namespace) -> int:
    """`jaxglider sweep --find-level`: campaigns at the levels of a bisection."""
    note_mission(options)
    (highest,) = options.uncertainty
    summaries: dict[float, CampaignSummary] = {}
    codes: list[int] = []
    note_needless_controller(gains_words(options), options.controller)

    def holds(level: float) -> bool:
        campaign = build(campaign_settings(options, level))
        for rule in options.require:
            rule.check(campaign.labels, measures_of(flight=campaign.has_flight))
        (name,) = folder_names([level]).values()
        code, summary = _execute(options, campaign, options.out / name)
        if code in (INTERRUPTED, RUN_FAILED) or summary is None:
            codes.append(code)
            raise _Stopped
        summaries[level] = summary
        verdicts = [
            entry["verdict"] for entry in summary.requirements if "parts" in entry
        ]
        return all(verdict == "met" for verdict in verdicts)

    threshold = None
    with contextlib.suppress(_Stopped):
        threshold = find_threshold(holds, highest, highest / LEVELS)
    named_levels = {
        folder_names([level])[level]: summaries[level] for level in sorted(summaries)
    }
    if not summaries:
        return codes[0]
    write_levels(options.out, named_levels, not options.no_report, threshold)
    words = "" if threshold is None else f"the specification {threshold.text()}."
    result: dict[str, Any] = {"levels": named(named_levels)}
    if threshold is not None:
        result["specification"] = dataclasses.asdict(threshold)
    print_result(result, words, as_json=options.json)
    return codes[0] if codes else OK


class _Stopped(Exception):
    """A campaign of a bisection was interrupted or failed."""


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
    rules = [rule.quantity for rule in options.require]
    numbers = [isinstance(level, float) for level in options.uncertainty]
    if options.find_level and (numbers != [True] or SPECIFICATION not in rules):
        raise ValueError(
            "--find-level goes with --require spec and one number for --uncertainty, "
            "the highest level to try."
        )
    if options.find_level and (options.hosts > 1 or options.shard != (1, 1)):
        raise ValueError("--find-level does not go with --shard or --hosts.")
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
