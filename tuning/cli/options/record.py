"""The options of `record` and `fit`; nothing here imports JAX."""

import argparse
from pathlib import Path
from typing import Any

from tuning.cli.options.arguments import (
    add_common,
    add_overwrite,
    positive,
    whole,
)

KINDS = ("steady", "driven", "closed")
"""Names of the fits, the lightest first."""
SPLITS = ("half", "alternate")
"""Ways of holding dives out."""


def _add_files(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="files of one flight, or folders of them: Slocum .dbd/.ebd (.cac beside "
        "them), gliderflight's .npy, SeaExplorer .gli. and .pld. files, OG-1.0 or "
        "Seaglider NetCDF, or a .csv with units in its heads",
    )
    parser.add_argument(
        "--flip",
        nargs="+",
        default=[],
        metavar="CHANNEL",
        help="channels whose sign is the other one in these files, such as pitch",
    )


def add_record(commands: Any) -> None:
    """`jaxglider record`."""
    text = "say what a flight record holds, and what it lacks for which fit"
    parser = commands.add_parser("record", help=text, description=text + ".")
    _add_files(parser)
    add_common(parser, "results/record")


def add_fit(commands: Any) -> None:
    """`jaxglider fit`."""
    text = "fit a vehicle to its flight record"
    parser = commands.add_parser(
        "fit",
        help=text,
        description=text + ", judge it on dives held out, and write vehicle.toml, "
        "uncertainty.toml and mission.toml for trim, tune, sweep and export.",
    )
    _add_files(parser)
    parser.add_argument(
        "--vehicle",
        default="slocum",
        metavar="NAME|FILE",
        help="where to start from; its standard deviations are the priors; "
        "default: slocum",
    )
    parser.add_argument(
        "--kind",
        choices=KINDS,
        default="driven",
        help="steady glides; driven by the recorded pitch; or closed: from the "
        "actuators alone; default: driven",
    )
    parser.add_argument(
        "--free",
        nargs="+",
        default=[],
        metavar="NAME",
        help="numbers to fit, `*` for any letters; default: those that such a record "
        "may tell",
    )
    parser.add_argument(
        "--no-speed",
        action="store_true",
        help="keep a recorded speed through the water for judging only",
    )
    parser.add_argument(
        "--mass",
        type=positive,
        metavar="KG",
        help="of the glider as it was weighed; its hull is changed to that",
    )
    parser.add_argument(
        "--volume",
        type=positive,
        metavar="M3",
        help="displaced at the surface with no ballast pumped; default: mass over the "
        "mean density of the record",
    )
    parser.add_argument(
        "--held-out",
        choices=SPLITS,
        default="half",
        help="dives to be judged on: the second half, or every other; default: half",
    )
    parser.add_argument(
        "--profile",
        type=whole,
        default=2,
        metavar="N",
        help="look along the likelihood of the N numbers that the record tells worst; "
        "default: 2",
    )
    add_overwrite(parser)
    add_common(parser, "results/fit")
