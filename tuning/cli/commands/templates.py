"""The commands that write a commented file to begin with, and check a mission."""

import argparse
import sys
from pathlib import Path

from jaxglider.core.toml import reason
from jaxglider.files import mission, uncertainty
from jaxglider.files.writing import write_text
from jaxglider.simulation.checks.sense import sense_warnings
from jaxglider.simulation.checks.start import start_warnings
from tuning.evaluation.runs import note_stability
from tuning.reporting.console import note
from tuning.reporting.exit_codes import OK


def init(options: argparse.Namespace) -> int:
    """`jaxglider init`: a commented mission or uncertainty file.

    Raises:
        ValueError: the file exists.
        OSError: it cannot be written.
    """
    kind = "uncertainty" if options.uncertainty else "mission"
    path = options.path or Path(f"{kind}.toml")
    if path.exists() and not options.force:
        raise ValueError(f"{path} exists; choose another name or use --force.")
    template = (uncertainty if options.uncertainty else mission).TEMPLATE
    try:
        write_text(path, template())
    except OSError as error:
        raise OSError(f"{path} cannot be written: {reason(error)}.") from error
    use = "tune --uncertainty" if options.uncertainty else "simulate"
    sys.stdout.write(f"{path} written. Edit it, then: jaxglider {use} {path}\n")
    return OK


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
    note_stability(loaded.loop, always=False)
    clock = loaded.loop.scenario.clock
    sys.stdout.write(
        f"{options.path} is valid: {loaded.name}, {loaded.controller}, "
        f"{clock.ticks} ticks of {float(clock.dt):g} s.\n"
    )
    return OK
