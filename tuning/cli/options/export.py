"""Options of `export`, and of a controller that is another program; no JAX here."""

import argparse
from pathlib import Path
from typing import Any

from tuning.cli.options.arguments import (
    CONTROLLERS,
    OWN_LAW,
    PLANTS,
    SCENARIOS,
    add_dt,
    checked,
    law,
    positive,
)
from tuning.cli.options.missions import add_mission

FORMATS = ("c", "toml", "json", "stablehlo")
INPUTS = ("sensors", "state")


def add_export(commands: Any) -> None:
    """`jaxglider export`."""
    text = "write a controller for use outside: C99, gains as TOML or JSON, StableHLO"
    parser = commands.add_parser("export", help=text, description=text + ".")
    parser.add_argument(
        "--gains",
        metavar="FILE",
        help="gains file, as `tune` writes it; or `paper`, or `tuned`",
    )
    add_mission(parser, "mission file with the controller, instead of --gains")
    parser.add_argument(
        "--controller",
        type=law,
        metavar="NAME",
        help=f"what `paper` or `tuned` stands for: {', '.join(CONTROLLERS)}, or "
        f"{OWN_LAW}, which `paper` takes as it begins; default: fxtppc",
    )
    parser.add_argument(
        "--scenario",
        choices=SCENARIOS,
        help="task on board; default: what the gains were tuned for",
    )
    parser.add_argument(
        "--plant",
        choices=PLANTS,
        help="glider of the design model; default: what the gains were tuned for",
    )
    add_dt(parser)
    parser.add_argument("--format", choices=FORMATS, default="c", help="default: c")
    parser.add_argument(
        "--inputs",
        choices=INPUTS,
        help="what the code is told: raw samples of the mission's sensors, which it "
        "makes its state of, or the state itself, as without sensors; default: "
        "sensors where the mission has them",
    )
    parser.add_argument(
        "--patience",
        type=positive,
        default=10.0,
        metavar="S",
        help="how long old measurements stand in for missing ones [s]; default: 10",
    )
    parser.add_argument(
        "--safe",
        type=_number,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("KG", "M", "RAD"),
        help="command after that: buoyancy mass, position and angle of the moving "
        "mass; default: 0 0 0",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("results/export"),
        metavar="DIR",
        help="default: results/export",
    )
    parser.add_argument(
        "--overwrite",
        action="store_true",
        help="write to a folder that holds other files than those of an export, too",
    )
    parser.add_argument(
        "--json", action="store_true", help="print the result as JSON on stdout"
    )


def add_controller_binary(parser: argparse.ArgumentParser, steered: Any) -> None:
    """A program in the place of controller and observer.

    Args:
        parser: parser of the command.
        steered: group of the options that say who steers.
    """
    steered.add_argument(
        "--controller-binary",
        metavar="PROGRAM",
        help="ask this program for commands, in the place of controller and observer "
        "of the mission; `export` writes one",
    )
    parser.add_argument(
        "--controller-timeout",
        type=positive,
        default=5.0,
        metavar="S",
        help="how long it may take to answer [s]; default: 5",
    )


def _number(text: str) -> float:
    return float(checked(text, float, lambda x: abs(x) < 1e9, "a finite number"))
