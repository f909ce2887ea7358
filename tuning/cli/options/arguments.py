"""Arguments that commands share, and what they may be; nothing here imports JAX."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tuning.cli.options.missions import add_mission

SCENARIOS = ("switching", "waypoints")
PLANTS = ("printed", "rigid-body", "seawing")
ACTUATORS = ("vehicle", "ideal")
PAPER_CONTROLLERS = ("smc", "ppc", "fxtppc")
FLOWN = ("slocum", "seaglider", "seaexplorer")
TEXTBOOK = (
    "pid",
    "lqr",
    "lqi",
    "mpc",
    "adrc",
    "backstepping",
    "fixed-time-backstepping",
)
CONTROLLERS = (*PAPER_CONTROLLERS, "fxtppc-roll", *FLOWN, *TEXTBOOK)
ALL = "all"
HELD_BY_DEFAULT = (
    "k1-below-k2-squared",
    "inside-specification",
    "restart-inside",
    "surface-settles",
    "error-settles",
    "stable-loop",
)
HELD_ON_REQUEST = ("observer-set", "equal-edges")
OWN_LAW = "FILE.py:ClassName for a law of your own"


def positive(text: str) -> float:
    """A finite number above zero."""
    return checked(text, float, lambda x: 0.0 < x < math.inf, "a positive number")


def not_negative(text: str) -> float:
    """A finite number of at least zero."""
    return checked(text, float, lambda x: 0.0 <= x < math.inf, "zero or positive")


def below_one(text: str) -> float:
    """A number in [0, 1)."""
    return checked(text, float, lambda x: 0.0 <= x < 1.0, "a number in [0, 1)")


def share(text: str) -> float:
    """A number strictly between 0 and 1."""
    return checked(text, float, lambda x: 0.0 < x < 1.0, "a number between 0 and 1")


def count(text: str) -> int:
    """A whole number of at least one."""
    return checked(text, int, lambda n: n >= 1, "a whole number of at least 1")


def at_least_four(text: str) -> int:
    """A whole number of at least four."""
    return checked(text, int, lambda n: n >= 4, "a whole number of at least 4")


def whole(text: str) -> int:
    """A whole number of at least zero."""
    return checked(text, int, lambda n: n >= 0, "a whole number of at least 0")


def seed(text: str) -> int:
    """A seed."""
    return checked(text, int, lambda n: 0 <= n < 2**32, "a whole number in [0, 2^32)")


def law(text: str) -> str:
    """A control law: its name in the catalogue, or FILE.py:ClassName.

    Raises:
        argparse.ArgumentTypeError: it is neither.
    """
    path, _, name = text.rpartition(":")
    if text in CONTROLLERS or (path.endswith(".py") and name.isidentifier()):
        return text
    raise argparse.ArgumentTypeError(
        f"must be one of {', '.join(CONTROLLERS)}, or {OWN_LAW}; received {text!r}."
    )


def law_or_all(text: str) -> str:
    """A control law as `law` has it, or the word for all of the catalogue."""
    return text if text == ALL else law(text)


class Laws(argparse.Action):
    """Laws by their names, `all` standing for every one of the catalogue."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Put the names in the place of the word."""
        names = [n for word in values for n in (CONTROLLERS if word == ALL else [word])]
        setattr(namespace, self.dest, list(dict.fromkeys(names)))


def uncertainty(text: str) -> float | Path:
    """A number in [0, 1), or the path of a file."""
    if Path(text).suffix == ".toml":
        return Path(text)
    rule = "a number in [0, 1) or the path of a .toml file"
    value: float = checked(text, float, lambda x: 0.0 <= x < 1.0, rule)
    return value


def checked(text: str, kind: Any, holds: Callable[[Any], bool], rule: str) -> Any:
    """The text as a number of a kind.

    Args:
        text: word of the command line.
        kind: type of the number.
        holds: test that the number has to pass.
        rule: description of the test, for the message.

    Raises:
        argparse.ArgumentTypeError: it is none, or the rule does not hold.
    """
    try:
        value = kind(text)
    except ValueError:
        value = None
    if value is None or not holds(value):
        raise argparse.ArgumentTypeError(f"must be {rule}; received {text!r}.")
    return value


def add_dt(parser: argparse.ArgumentParser) -> None:
    """The control tick."""
    parser.add_argument(
        "--dt", type=positive, metavar="S", help="control tick [s]; default: 0.05"
    )


def add_actuators(parser: argparse.ArgumentParser) -> None:
    """The actuators."""
    parser.add_argument(
        "--actuators",
        choices=ACTUATORS,
        help="vehicle: they move as fast as the vehicle's file says; ideal: they jump "
        "to their command, as in the paper; default: ideal on printed, else vehicle",
    )


def add_controller(parser: argparse.ArgumentParser) -> None:
    """The control law of one closed loop."""
    parser.add_argument(
        "--controller",
        type=law,
        metavar="NAME",
        help=f"{', '.join(CONTROLLERS)}, or {OWN_LAW}; default: fxtppc, or what "
        "--gains or --config has",
    )


def add_case(parser: argparse.ArgumentParser) -> None:
    """Options of the case: one of the paper's, or a mission file."""
    add_mission(
        parser,
        "a mission of your own instead of a case of the paper: vehicle, "
        "actuators, sea, task and clock (`jaxglider init` writes one to start from)",
    )
    parser.add_argument("--scenario", choices=SCENARIOS, help="default: switching")
    parser.add_argument("--plant", choices=PLANTS, help="default: rigid-body")
    add_actuators(parser)
    add_duration(parser)
    add_dt(parser)


def add_duration(parser: argparse.ArgumentParser) -> None:
    """The horizon."""
    parser.add_argument(
        "--duration",
        type=positive,
        metavar="S",
        help="horizon [s]; default: the case's or the mission's own",
    )


def add_common(parser: argparse.ArgumentParser, out: str) -> None:
    """Options of the results: folder, precision, and form of printing."""
    add_output(parser)
    parser.add_argument(
        "--out", type=Path, default=Path(out), metavar="DIR", help=f"default: {out}"
    )


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Leave to replace what another command has written."""
    parser.add_argument(
        "--overwrite",
        action="store_true",
        help="replace the results of another command in --out",
    )


def add_table(parser: argparse.ArgumentParser) -> None:
    """Trajectories as tables, tracks to zoom into, and dives as pages."""
    parser.add_argument(
        "--table",
        choices=("csv", "parquet"),
        help="write each trajectory as such a table too; parquet needs pyarrow",
    )
    parser.add_argument(
        "--interactive",
        action="store_true",
        help="tracks in report.html that one can zoom into; needs plotly, and makes "
        "the report 5 MB larger",
    )
    parser.add_argument(
        "--pages",
        action="store_true",
        help="write figures/dives-....pdf too, a page for each dive of a yo",
    )


def add_output(parser: argparse.ArgumentParser) -> None:
    """Precision, and how the result is printed."""
    parser.add_argument(
        "--precision", type=int, choices=(32, 64), default=64, help="default: 64"
    )
    parser.add_argument(
        "--json", action="store_true", help="print the result as JSON on stdout"
    )
