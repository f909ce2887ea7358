"""The options of `vehicles` and `trim`; nothing here imports JAX."""

import argparse
import math
from typing import Any

from tuning.cli.options.arguments import PLANTS, add_common, checked, positive


def finite(text: str) -> float:
    """A finite number."""
    return checked(text, float, math.isfinite, "a finite number")


def glide_angle(text: str) -> float:
    """A glide angle in degrees: neither level nor straight down."""
    return checked(
        text,
        float,
        lambda x: 0.0 < abs(x) < 90.0,
        "in (-90, 90) and not 0, negative for a dive",
    )


def not_zero(text: str) -> float:
    """A finite number other than zero."""
    return checked(
        text, float, lambda x: math.isfinite(x) and x != 0.0, "a number other than 0"
    )


def add_missions(commands: Any) -> None:
    """`jaxglider missions`."""
    text = "list the missions of the package"
    parser = commands.add_parser("missions", help=text, description=text + ".")
    parser.add_argument("--show", metavar="NAME", help="print the file of one")
    parser.add_argument("--json", action="store_true", help="print them as JSON")


def add_vehicles(commands: Any) -> None:
    """`jaxglider vehicles`."""
    text = "list the vehicles that come with the package"
    parser = commands.add_parser("vehicles", help=text, description=text + ".")
    parser.add_argument(
        "--show",
        metavar="NAME",
        help="print the file of one, to copy and change: units, sources, doubts",
    )
    parser.add_argument(
        "--json", action="store_true", help="print the list as JSON on stdout"
    )


def add_trim(commands: Any) -> None:
    """`jaxglider trim`."""
    text = "steady glides and spirals: state, modes, controllability, glide polar"
    parser = commands.add_parser(
        "trim",
        help=text,
        description=text + ". Give a command, or what is wanted instead of it; what "
        "is left out is a moderate straight dive.",
    )
    parser.add_argument(
        "--vehicle",
        default="seawing",
        metavar="NAME|FILE",
        help="as `jaxglider vehicles` lists them, or a .toml file; default: seawing",
    )
    parser.add_argument(
        "--plant", choices=PLANTS, default="seawing", help="default: seawing"
    )
    _add_pair(
        parser,
        ("--buoyancy-mass", "KG", finite, "positive sinks"),
        ("--speed", "M_S", positive, "through the water, instead"),
    )
    _add_pair(
        parser,
        ("--mass-position", "M", finite, "of the moving mass, positive forward"),
        ("--glide-angle", "DEG", glide_angle, "of the path, negative dives, instead"),
    )
    _add_pair(
        parser,
        ("--mass-angle", "DEG", finite, "of the moving mass"),
        ("--turn-rate", "DEG_S", finite, "positive to starboard, instead"),
        ("--turn-radius", "M", not_zero, "positive to starboard, instead"),
    )
    add_common(parser, "results/trim")


def _add_pair(parser: argparse.ArgumentParser, *choices: Any) -> None:
    group = parser.add_mutually_exclusive_group()
    for flag, metavar, kind, text in choices:
        group.add_argument(
            flag, type=kind, metavar=metavar, help=f"[{_unit(metavar)}] {text}"
        )


def _unit(metavar: str) -> str:
    return {"KG": "kg", "M_S": "m/s", "DEG_S": "deg/s"}.get(metavar, metavar.lower())
