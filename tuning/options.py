"""The options of the command line; nothing here imports JAX."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

SCENARIOS = ("switching", "waypoints")
PLANTS = ("printed", "rigid-body")
CONTROLLERS = ("smc", "ppc", "fxtppc")


def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    top = argparse.ArgumentParser(
        prog="jaxglider",
        description="Simulate, compare and tune controllers of underwater gliders.",
        epilog="Exit codes: 0 all well, 1 a run failed, 2 usage or configuration, "
        "3 a stated requirement is violated, 130 interrupted.",
    )
    top.add_argument("--version", action="version", version=_version())
    top.add_argument("--debug", action="store_true", help="show tracebacks of errors")
    commands = top.add_subparsers(dest="command", metavar="COMMAND")
    _add_compare(commands)
    _add_tune(commands)
    _add_check(commands)
    _add_simulate(commands)
    _add_init(commands)
    _add_validate(commands)
    for command in commands.choices.values():
        command.add_argument(
            "--debug",
            action="store_true",
            default=argparse.SUPPRESS,
            help=argparse.SUPPRESS,
        )
    return top


def _positive(text: str) -> float:
    return _checked(text, float, lambda x: 0.0 < x < math.inf, "a positive number")


def _count(text: str) -> int:
    return _checked(text, int, lambda n: n >= 1, "a whole number of at least 1")


def _seed(text: str) -> int:
    return _checked(text, int, lambda n: 0 <= n < 2**32, "a whole number in [0, 2^32)")


def _checked(text: str, kind: Any, holds: Callable[[Any], bool], rule: str) -> Any:
    try:
        value = kind(text)
    except ValueError:
        value = None
    if value is None or not holds(value):
        raise argparse.ArgumentTypeError(f"must be {rule}; received {text!r}.")
    return value


def _version() -> str:
    from importlib.metadata import version

    return f"jaxglider {version('jaxglider')}"


def _add_compare(commands: Any) -> None:
    text = "run the paper's cases, all controllers under the same sea"
    parser = commands.add_parser("compare", help=text, description=text + ".")
    parser.add_argument(
        "--scenario", choices=(*SCENARIOS, "all"), default="all", help="default: all"
    )
    parser.add_argument(
        "--plant", choices=PLANTS, default="printed", help="default: printed"
    )
    parser.add_argument(
        "--controllers",
        nargs="+",
        choices=CONTROLLERS,
        default=list(CONTROLLERS),
        metavar="NAME",
        help=f"any of {', '.join(CONTROLLERS)}; default: all",
    )
    parser.add_argument(
        "--gains",
        nargs="+",
        type=Path,
        default=[],
        metavar="FILE",
        help="gains files, as `tune` writes them, each compared as one more controller",
    )
    _add_dt(parser)
    _add_common(parser, "results/compare")


def _add_tune(commands: Any) -> None:
    text = "tune gains by gradient descent through the rollout"
    parser = commands.add_parser("tune", help=text, description=text + ".")
    _add_task(parser)
    _add_ensemble(parser)
    descent = parser.add_argument_group("descent")
    descent.add_argument(
        "--method",
        choices=("gradient", "cma", "random"),
        default="gradient",
        help="cma and random are black-box searches on the same budget, a gradient "
        "counted as five rollouts; default: gradient",
    )
    descent.add_argument(
        "--steps", type=_count, default=80, metavar="N", help="default: 80"
    )
    descent.add_argument(
        "--learning-rate",
        type=_positive,
        default=0.1,
        metavar="R",
        help="in the logarithm of a gain; default: 0.1",
    )
    descent.add_argument(
        "--optimizer", default="adam", metavar="NAME", help="of optax; default: adam"
    )
    descent.add_argument(
        "--patience",
        type=_count,
        default=40,
        metavar="N",
        help="stop after so many steps without progress; default: 40",
    )
    descent.add_argument(
        "--seed",
        type=_seed,
        default=0,
        metavar="N",
        help="of members and copies; default: 0",
    )
    descent.add_argument(
        "--resume", action="store_true", help="go on from the checkpoint in --out"
    )
    _add_common(parser, "results/tune")


def _add_check(commands: Any) -> None:
    text = "say how far the gradient of each gain can be trusted"
    parser = commands.add_parser("check-gradients", help=text, description=text + ".")
    _add_task(parser)
    parser.add_argument(
        "--short",
        action="store_true",
        help="differences only; no comparison of horizons and smoothing widths",
    )
    _add_output(parser)
    nominal = {"members": 1, "validation": 1, "test": 1}
    still = {"uncertainty": 0.0, "amplitude": 0.0, "position": 0.0}
    parser.set_defaults(**nominal, **still, aggregate=None, objective=None, seed=0)


def _add_task(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scenario", choices=SCENARIOS, default="switching", help="default: switching"
    )
    parser.add_argument(
        "--plant", choices=PLANTS, default="rigid-body", help="default: rigid-body"
    )
    parser.add_argument(
        "--controller", choices=CONTROLLERS, help="default: fxtppc, or what --gains has"
    )
    parser.add_argument(
        "--gains",
        type=Path,
        metavar="FILE",
        help="start here, not at the paper's gains",
    )
    parser.add_argument(
        "--free",
        nargs="+",
        default=[],
        metavar="PATH",
        help="what to tune: dotted paths, `*` for any component, as "
        "controller.gains.*.k1 controller.damping observer.integral; "
        "default: k1 and k2 of fxtppc, all gains of the others",
    )
    parser.add_argument(
        "--unconstrained",
        action="store_true",
        help="do not hold k1 < 3/4 k2^2 (each gain's own range is always held)",
    )
    parser.add_argument(
        "--duration",
        type=_positive,
        metavar="S",
        help="horizon [s]; default: the case's own",
    )
    _add_dt(parser)


def _add_ensemble(parser: argparse.ArgumentParser) -> None:
    ensemble = parser.add_argument_group("ensemble")
    ensemble.add_argument(
        "--members",
        type=_count,
        default=16,
        metavar="N",
        help="gliders and seas to descend on; 1: the nominal case alone; default: 16",
    )
    ensemble.add_argument(
        "--validation",
        type=_count,
        default=32,
        metavar="N",
        help="to choose by; default: 32",
    )
    ensemble.add_argument(
        "--test",
        type=_count,
        default=64,
        metavar="N",
        help="held out for the verdict; default: 64",
    )
    ensemble.add_argument(
        "--uncertainty",
        type=float,
        default=0.2,
        metavar="H",
        help="relative half width of masses, inertias and coefficients; default: 0.2",
    )
    ensemble.add_argument(
        "--amplitude",
        type=float,
        default=0.5,
        metavar="H",
        help="relative half width of the waves' amplitudes, phases free; default: 0.5",
    )
    ensemble.add_argument(
        "--position",
        type=float,
        default=0.0,
        metavar="M",
        help="half width of the starting position [m]; default: 0",
    )
    ensemble.add_argument(
        "--aggregate",
        choices=("mean", "cvar", "worst"),
        help="how members' costs become one; default: mean",
    )
    ensemble.add_argument(
        "--objective",
        type=Path,
        metavar="FILE",
        help="TOML with [weights] (tracking, effort, chattering, crowding, roll, "
        "roll_limit_rad, saturation) and [aggregate] (kind, share, sharpness)",
    )


def _add_simulate(commands: Any) -> None:
    text = "run one mission from a TOML file"
    parser = commands.add_parser("simulate", help=text, description=text + ".")
    parser.add_argument(
        "--config",
        type=Path,
        required=True,
        metavar="FILE",
        help="mission file; `jaxglider init` writes one to start from",
    )
    parser.add_argument(
        "--seed", type=_seed, metavar="N", help="of the sea, instead of the file's"
    )
    _add_common(parser, "results/simulate")


def _add_init(commands: Any) -> None:
    text = "write a commented mission file to start from"
    parser = commands.add_parser("init", help=text, description=text + ".")
    parser.add_argument(
        "path", nargs="?", type=Path, default=Path("mission.toml"), metavar="FILE"
    )
    parser.add_argument("--force", action="store_true", help="replace an existing file")


def _add_validate(commands: Any) -> None:
    text = "check a mission file without running it"
    parser = commands.add_parser("validate", help=text, description=text + ".")
    parser.add_argument("path", type=Path, metavar="FILE")


def _add_dt(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--dt",
        type=_positive,
        default=0.05,
        metavar="S",
        help="control tick [s]; default: 0.05",
    )


def _add_common(parser: argparse.ArgumentParser, out: str) -> None:
    _add_output(parser)
    parser.add_argument(
        "--out", type=Path, default=Path(out), metavar="DIR", help=f"default: {out}"
    )


def _add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--precision", type=int, choices=(32, 64), default=64, help="default: 64"
    )
    parser.add_argument(
        "--json", action="store_true", help="print the result as JSON on stdout"
    )
