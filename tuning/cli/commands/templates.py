"""The commands that write a file to begin with, check a mission, or turn settings."""

import argparse
import re
import sys
from pathlib import Path

import tomli_w

from jaxglider.core.toml import reason
from jaxglider.files import mission, uncertainty
from jaxglider.files.flight.missions import mission_summaries
from jaxglider.files.gains import read_gains
from jaxglider.files.settings.lists import KNOWN, Settings, read_settings, settings_of
from jaxglider.files.writing import write_text
from jaxglider.paper import PLANTS, VEHICLE, default_actuators
from jaxglider.signals import COMMAND_UNITS
from jaxglider.simulation.checks.sense import sense_warnings
from jaxglider.simulation.checks.start import start_warnings
from jaxglider.vehicle.published import load_vehicle
from tuning.evaluation.beforehand import note_lost
from tuning.reporting.console import note
from tuning.reporting.exit_codes import OK


def init(options: argparse.Namespace) -> int:
    """`jaxglider init`: a commented mission or uncertainty file.

    Raises:
        ValueError: the file exists.
        OSError: it cannot be written.
    """
    if options.uncertainty and (options.vehicle or options.plant):
        raise ValueError(
            "--vehicle and --plant go with a mission file, which says them; an "
            "uncertainty file says only how far numbers are off."
        )
    kind = "uncertainty" if options.uncertainty else "mission"
    path = options.path or Path(f"{kind}.toml")
    if path.exists() and not options.force:
        raise ValueError(f"{path} exists; choose another name or use --force.")
    text = (uncertainty if options.uncertainty else mission).TEMPLATE()
    if options.vehicle or options.plant:
        text = _for_glider(text, options.vehicle or VEHICLE, options.plant)
    try:
        write_text(path, text)
    except OSError as error:
        raise OSError(f"{path} cannot be written: {reason(error)}.") from error
    use = "tune --uncertainty" if options.uncertainty else "simulate"
    sys.stdout.write(f"{path} written. Edit it, then: jaxglider {use} {path}\n")
    if options.vehicle and options.vehicle != VEHICLE:
        sys.stdout.write(_as_it_flies(options.vehicle, path))
    return OK


def _as_it_flies(name: str, path: Path) -> str:
    """Sentences for a terminal on what suits another glider than the paper's."""
    text = (
        "Law and task are the paper's, made for a SeaWing: `jaxglider validate "
        f"{path}` says whether they suit.\n"
    )
    family = name.partition("-")[0]
    names = [
        mission
        for mission, about in mission_summaries().items()
        if about["vehicle"].partition("-")[0] == family
    ]
    if names:
        text += (
            f"As such a glider flies, with its own law: {', '.join(names)} "
            "(`jaxglider missions --show NAME > FILE` writes one).\n"
        )
    return text


def _for_glider(text: str, name: str, plant: str | None) -> str:
    """The mission template with another glider: its limits, and how it can be flown.

    Args:
        text: text of the template.
        name: name of a vehicle of the package, or the path of a .toml file.
        plant: name of the plant, or None for one that flies it.

    Raises:
        ValueError: the vehicle cannot be read, or its file is too short for the plant.
    """
    vehicle = load_vehicle(name)
    if plant is None:
        # The small-angle equations have no fin.
        plant = "rigid-body" if vehicle.fin is None else "seawing"
    PLANTS[plant](vehicle)
    data = str(Path(name).absolute()) if name.endswith(".toml") else name
    text = _put(text, "vehicle", "data", f'"{data}"')
    text = _put(text, "vehicle", "plant", f'"{plant}"')
    actuators = default_actuators(plant)
    text = _put(text, "actuators", "type", f'"{actuators}"')
    for key, unit in COMMAND_UNITS.items():
        table = f"actuators.{key}"
        limit = float(getattr(vehicle.limits, key))
        text = _put(text, table, f"limit_{unit}", f"{limit:.10g}")
        # A pump has rates of its own, which a rate here would replace.
        pumped = key == "buoyancy_mass" and vehicle.pump
        if actuators == "vehicle" and vehicle.rates is not None and not pumped:
            rate = float(getattr(vehicle.rates, key))
            text = _put(text, table, f"rate_limit_{unit}_s", f"{rate:.10g}")
    return text


def _put(text: str, table: str, key: str, value: str) -> str:
    """The template with a value, its comment in its column; what was left out is in."""
    start = text.index(f"[{table}]")
    line = re.compile(rf"^(?:# )?({key} = )\S+( *)(#.*)?$", re.MULTILINE)
    found = line.search(text, start)
    if found is None:
        raise LookupError(f"the template has no {table}.{key}")
    comment = found[3] or ""
    changed = f"{found[1]}{value}"
    if comment:
        changed = f"{changed} ".ljust(found.start(3) - found.start()) + comment
    return text[: found.start()] + changed + text[found.end() :]


def validate(options: argparse.Namespace) -> int:
    """`jaxglider validate`: whether a mission file can be flown, and makes sense.

    Raises:
        ValueError: it makes no sense, with `--strict`; or it cannot be flown.
        FloatingPointError: it is not finite at its start.
    """
    loaded = mission.load_mission(options.path)
    if loaded.stand_ins:
        note(loaded.stand_ins)
    found = [
        *loaded.remarks,
        *start_warnings(loaded.loop),
        *sense_warnings(loaded.loop),
    ]
    for warning in found:
        note(f"{'error' if options.strict else 'warning'}: {warning}")
    if found and options.strict:
        raise ValueError(
            f"{options.path}: {len(found)} errors, with --strict; without it they are "
            "warnings."
        )
    note_lost(loaded.loop)
    clock = loaded.loop.scenario.clock
    sys.stdout.write(
        f"{options.path} is valid: {loaded.name}, {loaded.controller}, "
        f"{clock.ticks} ticks of {float(clock.dt):g} s.\n"
    )
    return OK


def settings(options: argparse.Namespace) -> int:
    """`jaxglider settings`: an autopilot's list as gains, and gains as such a list.

    Raises:
        ValueError: a file cannot be used.
        OSError: the result cannot be written.
    """
    if options.path.suffix == ".toml":
        tables = read_gains(options.path)
        listed = settings_of(tables, str(options.path))
        text = listed.text()
    else:
        listed = read_settings(options.path, options.law)
        text = tomli_w.dumps(listed.gains())
    if listed.unknown:
        note(f"not known to {listed.law}: {', '.join(listed.unknown)}.")
    if options.gains is not None:
        tuned = settings_of(read_gains(options.gains), str(options.gains))
        text = _changes(listed, tuned)
    if options.to is None:
        sys.stdout.write(text)
    else:
        write_text(options.to, text)
    return OK


def _changes(flown: Settings, tuned: Settings) -> str:
    """A line for each number that either has, as flown and as tuned.

    Raises:
        ValueError: they are for different laws.
    """
    if flown.law != tuned.law:
        raise ValueError(
            f"--gains must be of the law {flown.law}; received {tuned.law}."
        )
    lines = [f"{'':32} {'flown':>12} {'tuned':>12}"]
    for name, setting in KNOWN[flown.law].items():
        pair = flown.values.get(name), tuned.values.get(name)
        if pair != (None, None):
            cells = ["-" if x is None else f"{x:.4g}" for x in pair]
            title = f"{name} [{setting.unit}]"
            lines.append(f"{title:32} {cells[0]:>12} {cells[1]:>12}")
    return "\n".join(lines) + "\n"
