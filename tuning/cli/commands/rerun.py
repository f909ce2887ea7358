"""The command that runs one member of a campaign again, with its whole trajectory.

The member's row is computed again by the campaign's own program, and compared with the
one on disk bit for bit. The trajectory comes from a program that keeps every tick, as a
piece of the same width; its metrics are compared with the row too, and where a compiler
has made of it something that differs in the last bits, the command says so.
"""

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxglider.core.batching import BLOCK
from jaxglider.files.results import write_trajectories
from jaxglider.files.writing import provenance, write_json
from jaxglider.plotting import save_all
from jaxglider.simulation.rollout import Trajectory, simulate
from jaxglider.uncertainty.members import Member, with_member
from tuning.campaign.analysis.summary import ranked
from tuning.campaign.run.campaign import Campaign, build
from tuning.campaign.run.engine import Engine
from tuning.campaign.run.loop import compute, draw
from tuning.campaign.run.rows import (
    METRIC_COLUMNS,
    Rows,
    flatten,
    unit,
)
from tuning.campaign.run.store import Manifest, read_manifest, read_rows, whole_rows
from tuning.evaluation.failures import until_failure
from tuning.evaluation.runs import FinishedRun, PlannedRun
from tuning.reporting.console import Progress, note, print_result
from tuning.reporting.flights import markdown_flight, text_flight
from tuning.reporting.html import write_html
from tuning.reporting.navigation import markdown_navigation, text_navigation
from tuning.reporting.output_folder import writing_to
from tuning.reporting.statistics import plain
from tuning.reporting.tables import (
    headline,
    markdown_table,
    markdown_tables,
    text_table,
)


def rerun(options: argparse.Namespace) -> int:
    """`jaxglider rerun`: one member for every set of gains of its campaign."""
    manifest = read_manifest(options.folder)
    table = _table(options.folder, manifest)
    member = _number(options, manifest, table)
    campaign = build(manifest.settings)
    out = options.out or options.folder / f"member-{member}"
    with writing_to(out):
        _rerun(options, manifest, table, campaign, member, out)
    return 0


def _rerun(
    options: argparse.Namespace,
    manifest: Manifest,
    table: Rows,
    campaign: Campaign,
    member: int,
    out: Path,
) -> None:
    """Compute, compare and write."""
    progress = Progress()
    progress.show("compiling ...")
    engine = Engine(
        campaign.loops, draw(campaign, member, 1)[1], jax.local_devices()[:1]
    )
    again = compute(campaign, engine, member, 1)
    kept = table.rows[table.rows["member"] == member]
    runs = {
        label: trajectory(campaign, number, member)
        for number, label in enumerate(campaign.labels)
    }
    progress.clear()
    result = _result(campaign, manifest, kept[0], again[0], runs)
    _compare(result)
    runs = _explained(campaign, member, runs, result)
    progress.show(f"writing to {out} ...")
    write_json(out / "member.json", result)
    loop = with_member(campaign.loops[0], _one(draw(campaign, member, 1)[1]))[0]
    about, origin = result["provenance"], loop.scenario.origin
    write_trajectories(out / "trajectories.nc", runs, about, origin)
    settings = manifest.settings
    flown = headline(settings.scenario, settings.vehicle, settings.plant)
    title = f"member {member}, {flown}"
    figures = save_all(out / "figures", loop.scenario, runs, ("png",), {}, title)
    write_html(out / "report.html", _page(result, title), about, figures)
    progress.clear()
    note(
        f"{out}: member.json, trajectories.nc and {len(figures)} figures, all in "
        "report.html too."
    )
    told = [
        text(run) for text in (text_flight, text_navigation) for run in result["runs"]
    ]
    text = "\n\n".join([text_table(result["runs"]), *filter(None, told)])
    print_result(result, f"member {member}\n{text}", as_json=options.json)


def _explained(
    campaign: Campaign,
    member: int,
    runs: dict[str, Trajectory],
    result: dict[str, Any],
) -> dict[str, Trajectory]:
    """The runs, those that failed until then alone; it is said why they did."""
    one, kept = _one(draw(campaign, member, 1)[1]), {}
    for number, (label, run) in enumerate(runs.items()):
        loop, sea, noise = with_member(campaign.loops[number], one)
        kept[label], failure = until_failure(loop, sea, run, noise=noise)
        if failure is not None:
            result["runs"][number]["failure"] = failure.to_dict()
            for line in failure.lines():
                note(f"{label}: {line}")
    return kept


def _page(result: dict[str, Any], title: str) -> str:
    """The member as Markdown: how it did, and what was drawn for it."""
    drawn = [
        [f"`{name}`", f"{entry['value']:.6g}", entry["unit"]]
        for name, entry in result["drawn"].items()
    ]
    head = ["what is uncertain", "drawn", "unit"]
    parts = [f"# {title[0].upper()}{title[1:]}\n", markdown_tables(result["runs"])]
    for told in (markdown_flight, markdown_navigation):
        parts += [line for run in result["runs"] for line in told(run)]
    return "\n".join([*parts, "## What was drawn\n", *markdown_table(head, drawn, 1)])


def _table(folder: Path, manifest: Manifest) -> Rows:
    path = folder / "rows.bin"
    count = whole_rows(path, manifest.row_type(), manifest.first)
    if count == 0:
        raise ValueError(f"{folder} holds no members yet; go on with its sweep.")
    return Rows(read_rows(path, manifest.row_type())[:count], manifest.labels)


def _number(options: argparse.Namespace, manifest: Manifest, table: Rows) -> int:
    """The member asked for.

    Raises:
        ValueError: the campaign has no such member or gains.
    """
    if isinstance(options.member, int):
        low, high = manifest.first, manifest.first + len(table) - 1
        if not low <= options.member <= high:
            raise ValueError(
                f"--member must be in [{low}, {high}], the members of "
                f"{options.folder}; received {options.member}."
            )
        return int(options.member)
    label = options.gains or table.labels[0]
    if label not in table.labels:
        raise ValueError(
            f"--gains must be one of {', '.join(table.labels)}; received {label!r}."
        )
    order = ranked(table, table.labels.index(label))
    return order[-1] if options.member == "worst" else order[(len(table) - 1) // 2]


def trajectory(campaign: Campaign, number: int, member: int) -> Trajectory:
    """The whole run of one member, computed as one lane of a full block.

    Args:
        campaign: campaign that the member belongs to.
        number: number of the set of gains.
        member: number of the member.
    """
    alone = draw(campaign, member, 1)[1]
    lanes = jax.tree.map(lambda x: np.repeat(np.asarray(x), BLOCK, axis=0), alone)

    def run(loop: Any, members: Member) -> Trajectory:
        every = jax.vmap(lambda one: simulate(*with_member(loop, one)))(members)
        first: Trajectory = jax.tree.map(lambda x: x[0], every)
        return first

    found: Trajectory = jax.device_get(jax.jit(run)(campaign.loops[number], lanes))
    return found


def _one(members: Member) -> Member:
    first: Member = jax.tree.map(lambda x: x[0], members)
    return first


def _result(
    campaign: Campaign,
    manifest: Manifest,
    kept: Any,
    again: Any,
    runs: dict[str, Trajectory],
) -> dict[str, Any]:
    settings = manifest.settings
    where = settings.scenario, settings.vehicle, settings.plant
    found = []
    for number, (label, run) in enumerate(runs.items()):
        row = kept["metrics"][number]
        metrics = row[: len(METRIC_COLUMNS)]
        loop = campaign.loops[number]
        entry = PlannedRun(*where, label, loop, published=False)
        found.append(
            {
                **FinishedRun(entry, run).summary(),
                "row_equal": _equal(row, again["metrics"][number]),
                "trajectory_equal": _equal(metrics, flatten(run.metrics)),
                "largest_difference": _difference(metrics, flatten(run.metrics)),
            }
        )
    drawn = {
        name: {"value": float(value), "unit": units, "path": path}
        for (name, path, units), value in zip(
            manifest.quantities, kept["values"], strict=True
        )
    }
    row = {
        label: {
            name: {"value": plain(value), "unit": unit(name)}
            for name, value in zip(
                manifest.columns, kept["metrics"][number], strict=True
            )
        }
        for number, label in enumerate(runs)
    }
    about = provenance(command=sys.argv[1:], precision=settings.precision)
    about["campaign"] = dataclasses.asdict(settings) | {"gains": list(runs)}
    return {
        "member": int(kept["member"]),
        "drawn": drawn,
        "row": row,
        "runs": found,
        "provenance": about,
    }


def _equal(first: np.ndarray, second: np.ndarray) -> bool:
    return bool(np.array_equal(first, second, equal_nan=True))


def _difference(first: np.ndarray, second: np.ndarray) -> float | None:
    """The largest relative difference; None where one alone is not a number."""
    with np.errstate(invalid="ignore"):
        size = np.maximum(np.abs(first), np.abs(second))
        apart = np.abs(first - second) / np.where(size > 0.0, size, 1.0)
    return plain(np.where(np.isnan(first) & np.isnan(second), 0.0, apart).max())


def _compare(result: dict[str, Any]) -> None:
    """Say where a run is not the campaign's own."""
    for run in result["runs"]:
        if not run["row_equal"]:
            note(
                f"{run['controller']}: this machine gives another row than the "
                "campaign has: other versions, device or precision."
            )
        elif not run["trajectory_equal"]:
            note(
                f"{run['controller']}: the program that keeps every tick differs from "
                "the campaign's in the last bits; metrics are apart by up to "
                f"{run['largest_difference']} of their size."
            )
