"""The options of the command line; nothing here imports JAX."""

import argparse
from pathlib import Path
from typing import Any

from tuning.cli.options.arguments import (
    CONTROLLERS,
    OWN_LAW,
    PLANTS,
    SCENARIOS,
    Laws,
    add_actuators,
    add_common,
    add_dt,
    add_duration,
    add_overwrite,
    add_table,
    count,
    law,
    law_or_all,
    seed,
)
from tuning.cli.options.export import add_controller_binary, add_export
from tuning.cli.options.missions import add_mission, mission_file
from tuning.cli.options.record import add_fit, add_record
from tuning.cli.options.short_errors import Parser
from tuning.cli.options.sweep import add_merge, add_rerun, add_sweep
from tuning.cli.options.trim import add_missions, add_trim, add_vehicles
from tuning.cli.options.tune import add_check, add_tune
from tuning.cli.options.worst import add_worst


def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    top = Parser(
        prog="jaxglider",
        description="Simulate, compare and tune controllers of underwater gliders.",
        epilog="Exit codes: 0 all well, 1 a run failed, 2 usage or configuration, "
        "3 a stated requirement is violated, 130 interrupted.",
    )
    top.add_argument("--version", action="version", version=_version())
    top.add_argument("--debug", action="store_true", help="show tracebacks of errors")
    commands = top.add_subparsers(dest="command", metavar="COMMAND")
    _add_compare(commands)
    add_tune(commands)
    add_check(commands)
    add_sweep(commands)
    add_worst(commands)
    add_merge(commands)
    add_rerun(commands)
    _add_simulate(commands)
    add_export(commands)
    _add_init(commands)
    _add_validate(commands)
    _add_settings(commands)
    _add_cache(commands)
    add_missions(commands)
    add_vehicles(commands)
    add_trim(commands)
    add_record(commands)
    add_fit(commands)
    for command in commands.choices.values():
        command.add_argument(
            "--debug",
            action="store_true",
            default=argparse.SUPPRESS,
            help=argparse.SUPPRESS,
        )
    return top


def _version() -> str:
    from importlib.metadata import version

    return f"jaxglider {version('jaxglider')}"


def _add_compare(commands: Any) -> None:
    text = "run the paper's cases or a mission, all controllers under the same sea"
    parser = commands.add_parser("compare", help=text, description=text + ".")
    add_mission(parser, "a mission instead of the paper's cases")
    parser.add_argument("--scenario", choices=(*SCENARIOS, "all"), help="default: all")
    parser.add_argument("--plant", choices=PLANTS, help="default: printed")
    parser.add_argument(
        "--controllers",
        nargs="+",
        type=law_or_all,
        action=Laws,
        metavar="NAME",
        help=f"any of {', '.join(CONTROLLERS)}, or {OWN_LAW}; `all` for all of these "
        "but the last; default: the paper's three, or the mission's own",
    )
    parser.add_argument(
        "--gains",
        nargs="+",
        default=[],
        metavar="FILE",
        help="gains files, as `tune` writes them, each compared as one more "
        "controller; `tuned`: those that come with jaxglider for this case",
    )
    add_actuators(parser)
    add_duration(parser)
    add_dt(parser)
    add_table(parser)
    add_overwrite(parser)
    add_common(parser, "results/compare")


def _add_settings(commands: Any) -> None:
    text = "turn an autopilot's settings into a gains file, or a gains file into them"
    parser = commands.add_parser("settings", help=text, description=text + ".")
    parser.add_argument(
        "path",
        type=Path,
        metavar="FILE",
        help="list of names and numbers, or a gains file, which ends in .toml",
    )
    parser.add_argument(
        "--law",
        choices=("slocum", "seaglider", "seaexplorer"),
        default="slocum",
        help="law that a list is for; default: slocum",
    )
    parser.add_argument(
        "--gains",
        type=Path,
        metavar="FILE",
        help="gains file to put beside it: what tuning changed, in the vendor's units",
    )
    parser.add_argument(
        "--to", type=Path, metavar="FILE", help="file to write; default: stdout"
    )


def _add_simulate(commands: Any) -> None:
    text = "run one mission from a TOML file"
    parser = commands.add_parser("simulate", help=text, description=text + ".")
    add_mission(parser, "the same; `jaxglider init` writes one to start from")
    parser.add_argument(
        "--seed", type=seed, metavar="N", help="of the sea, instead of the file's"
    )
    add_duration(parser)
    parser.add_argument(
        "--keep-every",
        type=count,
        default=1,
        metavar="N",
        help="record every Nth tick alone, which must divide their number; default: 1",
    )
    parser.add_argument(
        "--stability",
        action="store_true",
        help="say first whether the loop is stable on the glides of its schedule",
    )
    steered = parser.add_mutually_exclusive_group()
    steered.add_argument(
        "--controller",
        type=law,
        metavar="NAME",
        help="law in the place of the mission's, with the gains it begins with: "
        f"{', '.join(CONTROLLERS)}, or {OWN_LAW}",
    )
    add_controller_binary(parser, steered)
    add_table(parser)
    parser.add_argument(
        "--og1",
        action="store_true",
        help="write the flight as OG-1.0 NetCDF too, as its glider would have recorded "
        "it; the mission must have a latitude and a longitude",
    )
    add_overwrite(parser)
    add_common(parser, "results/simulate")


def _add_init(commands: Any) -> None:
    text = "write a commented mission file to start from"
    parser = commands.add_parser("init", help=text, description=text + ".")
    parser.add_argument(
        "path",
        nargs="?",
        type=Path,
        metavar="FILE",
        help="default: mission.toml, or uncertainty.toml",
    )
    parser.add_argument(
        "--uncertainty",
        action="store_true",
        help="write a file that says what is uncertain instead, for "
        "`tune --uncertainty FILE`",
    )
    parser.add_argument(
        "--vehicle",
        metavar="NAME|FILE",
        help="glider of the mission, as `jaxglider vehicles` lists them, or a .toml "
        "file: limits and actuators become its own; default: seawing",
    )
    parser.add_argument(
        "--plant",
        choices=PLANTS,
        help="equations that it obeys; default: printed, and with --vehicle "
        "rigid-body, or seawing for a glider with a fin",
    )
    parser.add_argument("--force", action="store_true", help="replace an existing file")


def _add_validate(commands: Any) -> None:
    text = "check a mission file without running it"
    parser = commands.add_parser("validate", help=text, description=text + ".")
    parser.add_argument("path", type=mission_file, metavar="MISSION")
    parser.add_argument(
        "--strict", action="store_true", help="take every warning for an error"
    )


def _add_cache(commands: Any) -> None:
    text = "show where compiled programs are kept, or clear them"
    parser = commands.add_parser("cache", help=text, description=text + ".")
    parser.add_argument("--clear", action="store_true", help="remove all of them")
