"""The commands that run closed loops and write what came of them."""

import argparse
import dataclasses
import json
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import jax

from jaxglider import paper
from jaxglider._toml import read_toml
from jaxglider.config import Mission, load_mission, start_warnings
from jaxglider.guard import status_names
from jaxglider.io import (
    metrics_dict,
    provenance,
    replacing,
    write_json,
    write_text,
    write_trajectories,
)
from jaxglider.observer import NoObserver
from jaxglider.pipe import Peer, PipeController
from jaxglider.plotting import save_all
from jaxglider.rollout import ClosedLoop, simulate
from jaxglider.trajectory import Trajectory
from tuning.case import DT
from tuning.gain_files import resolve
from tuning.progress import Progress, note
from tuning.tables import markdown_tables, text_table

OK, RUN_FAILED, INTERRUPTED = 0, 1, 130
LABELS = {
    "smc": "SMC",
    "ppc": "PPC",
    "fxtppc": "FxTPPC",
    "fxtppc-roll": "FxTPPC-roll",
}


@dataclasses.dataclass(frozen=True)
class Entry:
    """One run to make: where, by whom, the loop, and whether the paper has the case."""

    scenario: str
    plant: str
    controller: str
    loop: ClosedLoop
    published: bool = True


@dataclasses.dataclass(frozen=True)
class Done:
    """One run made, its trajectory on the host."""

    entry: Entry
    trajectory: Trajectory

    def summary(self) -> dict[str, Any]:
        """As it stands in metrics.json."""
        return {
            "scenario": self.entry.scenario,
            "plant": self.entry.plant,
            "controller": self.entry.controller,
            "published_case": self.entry.published,
            **metrics_dict(
                self.trajectory.metrics,
                has_waypoints=self.entry.loop.scenario.reference.can_finish,
            ),
        }


def compare(options: argparse.Namespace) -> int:
    """`jaxglider compare`: the paper's cases under the same sea."""
    scenarios = paper.SCENARIOS if options.scenario == "all" else (options.scenario,)
    entries = [e for s in scenarios for e in _paper_entries(options, s)]
    for path in dict.fromkeys(options.gains):
        if path.exists():
            _note_origin(path, scenarios, options.plant)
    check_writable(options.out)
    done, interrupted = run_all(entries, seed=0)
    return _report(options, done, interrupted, seed=0)


def _note_origin(path: Path, scenarios: Sequence[str], plant: str) -> None:
    """Say so where gains meet another task than the one they were tuned for."""
    origin = read_toml(path).get("provenance", {})
    if not {"scenario", "plant"} <= set(origin):
        return
    if origin["plant"] != plant or set(scenarios) != {origin["scenario"]}:
        note(f"{path} was tuned for {origin['scenario']} on {origin['plant']}.")


def _paper_entries(options: argparse.Namespace, scenario: str) -> Iterator[Entry]:
    setting = paper.make_scenario(scenario, options.plant, dt=options.dt or DT)
    model = paper.design_model(setting.plant)
    for name in dict.fromkeys(options.controllers):
        loop = ClosedLoop(
            setting,
            paper.make_controller(name, scenario, model),
            paper.make_observer(name, model),
        )
        yield Entry(scenario, options.plant, name, loop)
    words = [str(path) for path in options.gains]
    for gains in resolve(words, options.controllers, scenario, options.plant):
        law = gains.load(scenario, model)
        yield Entry(scenario, options.plant, gains.label, law.on(setting))


def simulate_mission(options: argparse.Namespace) -> int:
    """`jaxglider simulate`: one mission from a file."""
    mission = load_mission(options.config)
    check_writable(options.out)
    for warning in start_warnings(mission.loop):
        note(f"warning: {warning}")
    seed = mission.seed if options.seed is None else options.seed
    if options.controller_binary is not None:
        return _simulate_outside(options, mission, seed)
    entry = Entry(
        mission.name, mission.plant, mission.controller, mission.loop, published=False
    )
    done, interrupted = run_all([entry], seed=seed)
    return _report(options, done, interrupted, seed)


def _simulate_outside(options: argparse.Namespace, mission: Mission, seed: int) -> int:
    """The same with a program in the place of controller and observer."""
    loop = mission.loop
    dt = float(loop.scenario.clock.dt)
    peer = Peer([options.controller_binary], dt, options.controller_timeout)
    try:
        outside = PipeController(getattr(loop.controller, "funnel", None), peer)
        loop = ClosedLoop(loop.scenario, outside, NoObserver())
        name = Path(options.controller_binary).name
        entry = Entry(mission.name, mission.plant, name, loop, published=False)
        done, interrupted = run_all([entry], seed=seed)
        if peer.failure is not None:
            note(f"{peer.failure} Nothing is written.")
            return RUN_FAILED
    finally:
        peer.close()
    for word, count in sorted(peer.statuses.items()):
        said = ", ".join(status_names(word)) or "unknown"
        note(f"status {word} on {count} ticks: {said}.")
    return _report(options, done, interrupted, seed)


def run_all(entries: list[Entry], seed: int) -> tuple[list[Done], bool]:
    """Run the entries one after the other; an interruption keeps what is done.

    Args:
        entries: what to run.
        seed: of the sea, the same for all.

    Returns:
        The runs made, and whether they were interrupted.
    """
    run = jax.jit(simulate)
    progress, done = Progress(), []
    try:
        for number, entry in enumerate(entries, 1):
            progress.show(
                f"{number}/{len(entries)} {entry.scenario}, {entry.controller}: "
                "compiling and running ..."
            )
            sea = entry.loop.scenario.sea(jax.random.key(seed))
            done.append(Done(entry, jax.device_get(run(entry.loop, sea))))
    except KeyboardInterrupt:
        return done, True
    finally:
        progress.clear()
    return done, False


def _report(
    options: argparse.Namespace, done: list[Done], interrupted: bool, seed: int
) -> int:
    """Print, write and draw what came of the runs."""
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
    for key in dict.fromkeys((s["scenario"], s["plant"]) for s in summaries):
        group = [s for s in summaries if (s["scenario"], s["plant"]) == key]
        tables.append(text_table(group) + "\n")
    print_result(result, "\n".join(tables), as_json=options.json)
    _write(options.out, done, result)
    failed = [s for s in summaries if not s["finite"]]
    for run in failed:
        note(f"{run['scenario']}, {run['controller']}: the run became non-finite.")
    if interrupted:
        return INTERRUPTED
    return RUN_FAILED if failed else OK


def print_result(result: dict[str, Any], text: str, *, as_json: bool) -> None:
    """Print a result as text or as JSON; a reader who has gone does no harm."""
    try:
        sys.stdout.write(
            json.dumps(result, indent=2, allow_nan=False) if as_json else text
        )
        sys.stdout.write("\n")
        sys.stdout.flush()
    except BrokenPipeError:
        # Stop Python from complaining when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _write(out: Path, done: list[Done], result: dict[str, Any]) -> None:
    progress = Progress()
    progress.show(f"writing to {out} ...")
    write_json(out / "metrics.json", result)
    write_text(out / "tables.md", markdown_tables(result["runs"]))
    runs = {
        f"{d.entry.scenario}/{d.entry.plant}/{d.entry.controller}": d.trajectory
        for d in done
    }
    write_trajectories(out / "trajectories.nc", runs, result["provenance"])
    figures = 0
    for scenario in dict.fromkeys(d.entry.scenario for d in done):
        progress.show(f"drawing {scenario} ...")
        group = [d for d in done if d.entry.scenario == scenario]
        labelled = {_label(d.entry.controller): d.trajectory for d in group}
        folder = out / "figures" / _file_name(scenario)
        figures += len(save_all(folder, group[0].entry.loop.scenario, labelled))
    progress.clear()
    note(f"{out}: metrics.json, tables.md, trajectories.nc and {figures} figures.")


def _label(controller: str) -> str:
    kind, _, rest = controller.partition(" ")
    return f"{LABELS.get(kind, kind)} {rest}".strip()


def _file_name(text: str) -> str:
    kept = "".join(c if c.isalnum() or c in "-_." else "-" for c in text)
    return kept.strip(".") or "run"


def check_writable(folder: Path) -> None:
    """Refuse a folder before the work, not after it.

    Raises:
        OSError: it cannot be made or written.
    """
    try:
        with replacing(folder / ".probe") as temporary:
            temporary.write_text("")
        (folder / ".probe").unlink()
    except OSError as error:
        raise OSError(f"--out {folder} cannot be written: {error}.") from error
