"""The commands that run closed loops and write what came of them."""

import argparse
import dataclasses
import functools
import math
import os
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxglider.core.kept.programs import kept
from jaxglider.files.results import json_number, metrics_dict, write_trajectories
from jaxglider.files.user_law import label_of
from jaxglider.files.writing import provenance, write_json, write_text
from jaxglider.guidance import Yo
from jaxglider.guidance.phases import STATUS_TEXTS, STATUSES
from jaxglider.plotting import save_all
from jaxglider.plotting.flight import save_dives
from jaxglider.simulation.checks.failure import Failure
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.flight import halves
from jaxglider.simulation.rollout import Trajectory, simulate
from tuning.evaluation.beforehand import note_lost
from tuning.evaluation.failures import command_that_shows, until_failure
from tuning.evaluation.trajectory_tables import write_table
from tuning.reporting.console import Progress, note, print_result
from tuning.reporting.exit_codes import INTERRUPTED, OK, RUN_FAILED
from tuning.reporting.flights import (
    FEW,
    markdown_flight,
    markdown_ranking,
    text_flight,
    text_ranking,
)
from tuning.reporting.html import write_html
from tuning.reporting.navigation import markdown_navigation, text_navigation
from tuning.reporting.tables import headline, markdown_tables, text_table
from tuning.reporting.tracks import interactive_tracks


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """One run to make: where, by whom, the loop, and whether the paper has the case."""

    scenario: str
    vehicle: str
    plant: str
    controller: str
    loop: ClosedLoop
    published: bool = True


@dataclasses.dataclass(frozen=True)
class FinishedRun:
    """One run made: its trajectory on the host, cut where it failed, and why."""

    entry: PlannedRun
    trajectory: Trajectory
    failure: Failure | None = None

    def summary(self) -> dict[str, Any]:
        """Entry of the run in metrics.json."""
        return {
            "scenario": self.entry.scenario,
            "vehicle": self.entry.vehicle,
            "plant": self.entry.plant,
            "controller": self.entry.controller,
            "published_case": self.entry.published,
            **metrics_dict(
                self.trajectory.metrics,
                has_waypoints=self.entry.loop.scenario.reference.waypoints is not None,
            ),
            **self._flight(),
            **({"failure": self.failure.to_dict()} if self.failure else {}),
        }

    def _flight(self) -> dict[str, Any]:
        """Dive by dive, where yos were flown."""
        rows = halves(self.trajectory)
        task = self.entry.loop.scenario.reference
        if isinstance(task, Yo):
            for row in rows:
                row["wanted_depth_rate_m_s"] = _wanted_rate(task, row["half"])
        plain = [{key: json_number(value) for key, value in r.items()} for r in rows]
        return {"halves": plain} if plain else {}


def _wanted_rate(task: Yo, half: str) -> float:
    """Depth rate that a mission wants of its dives or climbs [m/s], NaN for any."""
    wanted = getattr(task.settings, half).depth_rate
    if wanted is None:
        return math.nan
    return float(wanted) if half == "dive" else -float(wanted)


def run_all(
    entries: list[PlannedRun], seed: int, keep_every: int = 1
) -> tuple[list[FinishedRun], bool]:
    """Run the entries one after the other; an interruption keeps what is done.

    Args:
        entries: runs to make.
        seed: seed of the sea, one for all.
        keep_every: ticks from one that is recorded to the next.

    Raises:
        ValueError: it does not divide the ticks of a run.

    Returns:
        The runs made, and whether they were interrupted.
    """
    run = kept(functools.partial(simulate, keep_every=keep_every))
    progress, done = Progress(), []
    try:
        for number, entry in enumerate(entries, 1):
            progress.show(
                f"{number}/{len(entries)} {entry.scenario}, {entry.controller}: "
                "compiling and running ..."
            )
            key, scenario = jax.random.key(seed), entry.loop.scenario
            sea, noise = scenario.sea(key), scenario.noise(key)
            flown = jax.device_get(run(entry.loop, sea, noise))
            until = until_failure(entry.loop, sea, flown, keep_every, noise=noise)
            done.append(FinishedRun(entry, *until))
    except KeyboardInterrupt:
        return done, True
    finally:
        progress.clear()
    return done, False


def report_runs(
    options: argparse.Namespace, done: list[FinishedRun], interrupted: bool, seed: int
) -> int:
    """Print, write and draw the results of some runs.

    Args:
        options: options of the command.
        done: finished runs.
        interrupted: flag, some runs are missing.
        seed: seed of the sea.

    Returns:
        The exit code of the command.
    """
    if not done:
        note("interrupted before a run was finished; nothing is written.")
        return INTERRUPTED
    if interrupted:
        note(f"interrupted; keeping {len(done)} finished of the runs.")
    about = provenance(
        command=sys.argv[1:],
        seed=seed,
        precision=options.precision,
        partial=interrupted,
    )
    summaries = [one.summary() for one in done]
    result = {"runs": summaries, "provenance": about}
    tables = []
    for group in _groups(result):
        tables.append(text_table(group) + "\n")
        for run in group if len(group) <= FEW else ():
            texts = [x for x in (text_flight(run), text_navigation(run)) if x]
            if texts and len(group) > 1:
                texts[0] = f"{run['controller']}\n{texts[0]}"
            tables += [f"{text}\n" for text in texts]
        if ranking := text_ranking(group):
            tables.append(f"{ranking}\n")
    _write(options, done, result)
    print_result(result, "\n".join(tables), as_json=options.json)
    failed = [(d, s) for d, s in zip(done, summaries, strict=True) if d.failure]
    for one, run in failed:
        _note_failure(options, one, run)
    missed = [s for s in summaries if s.get("status", "completed") != "completed"]
    for run in missed:
        text = STATUS_TEXTS[STATUSES.index(run["status"])]
        note(f"{run['scenario']}, {run['controller']}: {run['status']}: {text}.")
    for one, run in zip(done, summaries, strict=True):
        _note_rolling(one, run)
    if interrupted:
        return INTERRUPTED
    return RUN_FAILED if failed or missed else OK


def _groups(result: dict[str, Any]) -> list[list[dict[str, Any]]]:
    """Summaries of the runs, those of one task together."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for run in result["runs"]:
        groups.setdefault((run["scenario"], run["plant"]), []).append(run)
    return list(groups.values())


def _note_failure(
    options: argparse.Namespace, one: FinishedRun, run: dict[str, Any]
) -> None:
    """Say why a run failed: the cause first, then what was seen and how to see it."""
    if one.failure is None:
        return
    first, *more = one.failure.lines()
    note(f"{run['scenario']}, {run['controller']}: {first}")
    for line in more:
        note(f"  {line}")
    note(
        f"  figures and trajectories.nc hold every tick until then. To see it: "
        f"{command_that_shows(options, run)}"
    )


def _note_rolling(one: FinishedRun, run: dict[str, Any]) -> None:
    """Say when a run of a mission rolled over, and where its loop is not stable."""
    if one.entry.published:
        return
    roll = np.abs(np.asarray(one.trajectory.ticks.state.roll, np.float64))
    over = roll > 0.5 * math.pi
    who = f"{run['scenario']}, {run['controller']}: "
    if over.any() and one.failure is None:
        when = float(one.trajectory.ticks.time[int(np.argmax(over))])
        note(f"{who}rolled past 90 deg at {when:.4g} s.")
    if over.any() or one.failure is not None:
        note_lost(one.entry.loop, who)


def _write(
    options: argparse.Namespace, done: list[FinishedRun], result: dict[str, Any]
) -> None:
    out, progress = options.out, Progress()
    progress.show(f"writing to {out} ...")
    write_json(out / "metrics.json", result)
    flights = [line for group in _groups(result) for line in markdown_ranking(group)]
    flights += [
        line
        for told in (markdown_flight, markdown_navigation)
        for run in result["runs"]
        for line in told(run)
    ]
    text = "\n".join([markdown_tables(result["runs"]), *flights, *_failures(done)])
    write_text(out / "tables.md", text)
    runs = {
        f"{d.entry.scenario}/{d.entry.plant}/{d.entry.controller}": d.trajectory
        for d in done
    }
    origin = done[0].entry.loop.scenario.origin
    write_trajectories(out / "trajectories.nc", runs, result["provenance"], origin)
    if options.table is not None:
        for label, run in runs.items():
            write_table(out / f"{_file_name(label)}.{options.table}", run)
    figures: list[Path] = []
    tracks: list[str] = []
    for scenario in dict.fromkeys(d.entry.scenario for d in done):
        progress.show(f"drawing {scenario} ...")
        group = [d for d in done if d.entry.scenario == scenario]
        labelled = {_label(d.entry.controller): d.trajectory for d in group}
        folder = out / "figures" / _file_name(scenario)
        one = group[0].entry
        title = headline(one.scenario, one.vehicle, one.plant)
        # The paper's performance functions say nothing of another mission.
        shapes: dict[str, Any] | None = None if one.published else {}
        flown = one.loop.scenario
        figures += save_all(folder, flown, labelled, ("png",), shapes, title)
        if options.interactive:
            tracks.append(interactive_tracks(labelled, title))
    write_html(out / "report.html", text, result["provenance"], figures, tracks)
    pages = _dives(out / "figures", done) if options.pages else ""
    progress.clear()
    note(
        f"{out}: metrics.json, tables.md, trajectories.nc and {len(figures)} figures, "
        f"all in report.html too{pages}."
    )


def _dives(folder: Path, done: list[FinishedRun]) -> str:
    """Pages of the dives of each run, and what to say of them."""
    count = 0
    for one in done:
        entry = one.entry
        name = _file_name(f"dives-{entry.scenario}-{entry.controller}.pdf")
        actuators = entry.loop.scenario.actuators
        title = f"{entry.scenario}, {_label(entry.controller)}"
        count += save_dives(folder / name, one.trajectory, actuators, title)
    return f"; {count} dives on a page each" if count else "; no dives, no pages"


def _failures(done: list[FinishedRun]) -> list[str]:
    """A section on the runs that failed, if any did."""
    lines = []
    for one in done:
        if one.failure is not None:
            lines.append(f"\n## {one.entry.scenario}, {one.entry.controller}: why\n")
            lines += [f"- {line}" for line in one.failure.lines()]
    return lines


def _label(controller: str) -> str:
    kind, _, rest = controller.partition(" ")
    return f"{label_of(kind)} {rest}".strip()


def _file_name(text: str) -> str:
    name = "".join(c if c.isalnum() or c in "-_." else "-" for c in text)
    try:
        os.fsencode(name)
    except UnicodeEncodeError:  # the locale's file names lack a letter
        name = "".join(c if c.isascii() else "-" for c in name)
    return name.strip(".") or "run"
