"""`jaxglider export`: a tuned controller for use outside of jaxglider."""

import argparse
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

import tomli_w

from jaxglider import paper
from jaxglider.core.toml import ConfigError
from jaxglider.export import export_c
from jaxglider.export.c.block import ExportError
from jaxglider.export.cost import Cost
from jaxglider.export.stablehlo import stablehlo
from jaxglider.files.gains import encode_law
from jaxglider.files.mission import load_mission
from jaxglider.files.writing import provenance, write_text
from jaxglider.onboard.guard import Guard
from jaxglider.onboard.of_loop import autopilot
from jaxglider.signals import Command
from jaxglider.simulation.closed_loop import ClosedLoop
from tuning.cli.session.from_options import (
    note_needless_controller,
    refuse_beside_mission,
)
from tuning.problem.case import FlightCase
from tuning.problem.gain_sets import read_files, resolve
from tuning.reporting.console import Progress, note, print_result
from tuning.reporting.exit_codes import OK
from tuning.reporting.output_folder import folder_name


def export(options: argparse.Namespace) -> int:
    """`jaxglider export`."""
    loop, title, about = _loop(options)
    earlier = _earlier(options.out)
    if not options.overwrite:
        _refuse_strange_folder(options.out, earlier)
    guard = _guard(options, loop)
    progress = Progress()
    progress.show(f"exporting {title} as {options.format} ...")
    try:
        files, cost = _files(options, loop, guard, title)
    except ExportError as error:
        raise ConfigError(f"{title} cannot be exported: {error}") from error
    finally:
        progress.clear()
    names = {*files, "gains.json" if options.format == "json" else "gains.toml"}
    if not options.overwrite:
        _refuse_strange_files(options.out, names - earlier)
    table = _table(loop, about, options.out, sorted(names | earlier))
    if options.format == "json":
        files["gains.json"] = json.dumps(table, indent=2) + "\n"
    else:
        files["gains.toml"] = tomli_w.dumps(table)
    for name, text in files.items():
        write_text(options.out / name, text)
    result: dict[str, Any] = {"title": title, "files": sorted(files)}
    lines = [f"{title}: {len(files)} files in {folder_name(options.out)}."]
    if cost is not None:
        result["cost"] = {
            "operations": cost.operations,
            "state_bytes": dict(
                zip(("float", "double"), cost.state_bytes, strict=True)
            ),
            "estimated_us_at_100_MHz": dict(
                zip(("float", "double"), cost.microseconds, strict=True)
            ),
        }
        lines.append(
            f"{sum(cost.operations.values())} operations a tick, "
            f"{cost.state_bytes[0]} bytes of state in float, {cost.state_bytes[1]} in "
            "double."
        )
        lines.append(f"Build and check it: make -C {options.out}")
    result["provenance"] = about
    print_result(result, "\n".join(lines), as_json=options.json)
    return OK


def _loop(options: argparse.Namespace) -> tuple[ClosedLoop, str, dict[str, Any]]:
    """The closed loop, what it is called, and where it comes from."""
    if (options.config is None) == (options.gains is None):
        raise ValueError(
            "either --gains FILE or a mission file is required, as MISSION or --config "
            f"FILE; received {'neither' if options.gains is None else 'both'}."
        )
    words = [] if options.gains is None else [options.gains]
    note_needless_controller(words, options.controller)
    if options.config is not None:
        refuse_beside_mission(options)
        mission = load_mission(options.config)
        if mission.stand_ins:
            note(mission.stand_ins)
        about = _about(scenario=mission.name, plant=mission.plant)
        title = f"{mission.controller} for {mission.name} on {mission.plant}"
        return mission.loop, title, about
    path = options.gains
    files = read_files([path])
    origin = files[path].get("provenance", {}) if path in files else {}
    mission_file = origin.get("mission") if isinstance(origin, dict) else None
    if mission_file and not (options.scenario and options.plant):
        raise ConfigError(
            f"{path} was tuned for the mission {mission_file}: name it there as "
            "controller.gains_file and export with --config, or give --scenario and "
            "--plant."
        )
    scenario = options.scenario or _known(origin, "scenario", paper.SCENARIOS)
    plant = options.plant or _known(origin, "plant", tuple(paper.PLANTS))
    case = FlightCase.of_paper(scenario, plant, options.dt, None)
    (gains,) = resolve(
        [path], [options.controller or "fxtppc"], scenario, plant, files=files
    )
    about = _about(gains=gains.origin, scenario=scenario, plant=plant)
    title = f"{gains.label} for {scenario} on {plant}"
    return case.loop(gains)[1], title, about


def _known(origin: Any, key: str, allowed: tuple[str, ...]) -> str:
    """The case that gains were tuned for, or the first of those there are."""
    said = origin.get(key) if isinstance(origin, dict) else None
    return said if said in allowed else allowed[0]


def _about(**more: Any) -> dict[str, Any]:
    return provenance(command=sys.argv[1:], **more)


def _guard(options: argparse.Namespace, loop: ClosedLoop) -> Guard:
    safe = Command(*options.safe)
    for name, value in vars(safe).items():
        limit = float(getattr(loop.scenario.actuators, name).limit)
        if abs(float(value)) > limit:
            raise ValueError(
                f"--safe: {name} must be within the actuator's limit of {limit:g}; "
                f"received {float(value):g}."
            )
    return Guard(patience=options.patience, safe=safe)


def _files(
    options: argparse.Namespace, loop: ClosedLoop, guard: Guard, title: str
) -> tuple[dict[str, str], Cost | None]:
    """Texts by name but for the gains, and what a tick costs where that can be said."""
    if options.inputs == "sensors" and loop.scenario.instruments is None:
        raise ValueError(
            "--inputs sensors needs a mission with a table [sensors]; received one "
            "without. Add the table, or leave the option out."
        )
    told_state = options.inputs == "state"
    if options.format == "stablehlo":
        return stablehlo(autopilot(loop, guard, told_state=told_state)), None
    if options.format != "c":
        return {}, None
    made = export_c(loop, title, guard, told_state=told_state)
    return dict(made.files), made.cost


def _table(
    loop: ClosedLoop, about: dict[str, Any], folder: Path, names: list[str]
) -> dict[str, Any]:
    """Gains as `tune` writes them, with the names of all files of the export."""
    return {
        **encode_law(loop, folder),
        "provenance": {
            **{k: about[k] for k in ("created", "versions", "scenario", "plant")},
            "command": "jaxglider " + " ".join(about["command"]),
            "exported": names,
        },
    }


def _earlier(folder: Path) -> set[str]:
    """Names of the files that earlier exports wrote to a folder and that are there."""
    names: set[str] = set()
    for file, read in (("gains.toml", tomllib.loads), ("gains.json", json.loads)):
        try:
            table = read((folder / file).read_text(encoding="utf-8"))
            names.update(map(str, table["provenance"]["exported"]))
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return {name for name in names if (folder / name).exists()}


def _refuse_strange_folder(folder: Path, earlier: set[str]) -> None:
    """Refuse a folder with files and no export among them; hidden ones do not count.

    Raises:
        ValueError: names the folder and some of its files.
    """
    there = sorted(p.name for p in folder.iterdir() if not p.name.startswith("."))
    if there and not earlier:
        more = ", ..." if len(there) > 3 else ""
        raise ValueError(
            f"--out {folder} holds files that no export wrote ({', '.join(there[:3])}"
            f"{more}). Give a folder of its own, or --overwrite to write among them."
        )


def _refuse_strange_files(folder: Path, names: set[str]) -> None:
    """Refuse to replace files that no export wrote.

    Raises:
        ValueError: names the folder and the files.
    """
    there = sorted(name for name in names if (folder / name).exists())
    if there:
        raise ValueError(
            f"--out {folder}: {', '.join(there)} would be replaced, and no export "
            "wrote that. Give another folder, or --overwrite to replace."
        )
