"""The command line: `jaxglider compare | simulate | tune | init | validate`.

Heavy imports wait until a command needs them, so `--help` answers at once. Exit
codes: 0 all well, 1 a run failed, 2 usage or configuration, 3 a stated requirement is
violated, 130 interrupted.
"""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

OK, RUN_FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130

SCENARIOS = ("switching", "waypoints")
PLANTS = ("printed", "rigid-body")
CONTROLLERS = ("smc", "ppc", "fxtppc")


def main(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit code."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.command is None:
        parser.print_help()
        return USAGE
    try:
        return int(_COMMANDS[options.command](options))
    except KeyboardInterrupt:
        _complain("interrupted.")
        return INTERRUPTED
    except BrokenPipeError:
        # The reader has gone; stop Python from complaining when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except FloatingPointError as error:
        _complain(str(error))
        return RUN_FAILED
    except (OSError, ValueError) as error:
        if options.debug:
            raise
        _complain(str(error))
        return USAGE


def _complain(text: str) -> None:
    sys.stderr.write(f"jaxglider: {text}\n")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="jaxglider",
        description="Simulate, compare and tune controllers of underwater gliders.",
        epilog="Exit codes: 0 all well, 1 a run failed, 2 usage or configuration, "
        "3 a stated requirement is violated, 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=_version())
    parser.add_argument(
        "--debug", action="store_true", help="show tracebacks of errors"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    _add_compare(commands)
    _add_tune(commands)
    _add_simulate(commands)
    _add_init(commands)
    _add_validate(commands)
    return parser


def _version() -> str:
    from importlib.metadata import version

    return f"jaxglider {version('jaxglider')}"


def _add_compare(commands: Any) -> None:
    text = "run the paper's cases, all controllers under the same sea"
    parser = commands.add_parser("compare", help=text, description=text + ".")
    parser.add_argument(
        "--scenario", choices=(*SCENARIOS, "all"), default="all", help="default: all"
    )
    parser.add_argument("--plant", choices=PLANTS, default="printed")
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
    text = "tune k1 and k2 of FxTPPC by gradient descent through the rollout"
    parser = commands.add_parser("tune", help=text, description=text + ".")
    parser.add_argument("--scenario", choices=SCENARIOS, default="switching")
    parser.add_argument("--plant", choices=PLANTS, default="printed")
    parser.add_argument(
        "--gains",
        type=Path,
        metavar="FILE",
        help="start here, not at the paper's gains",
    )
    parser.add_argument(
        "--steps", type=int, default=80, metavar="N", help="default: 80"
    )
    parser.add_argument(
        "--learning-rate",
        type=float,
        default=0.1,
        metavar="R",
        help="of Adam, in the logarithm of a gain; default: 0.1",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="horizon [s]; default: the case's own",
    )
    _add_dt(parser)
    _add_common(parser, "results/tune")


def _add_simulate(commands: Any) -> None:
    text = "run one mission from a TOML file"
    parser = commands.add_parser("simulate", help=text, description=text + ".")
    parser.add_argument("--config", type=Path, required=True, metavar="FILE")
    parser.add_argument(
        "--seed", type=int, metavar="N", help="of the sea, instead of the file's"
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
        type=float,
        default=0.05,
        metavar="S",
        help="control tick; default: 0.05",
    )


def _add_common(parser: argparse.ArgumentParser, out: str) -> None:
    parser.add_argument(
        "--precision", type=int, choices=(32, 64), default=64, help="default: 64"
    )
    parser.add_argument(
        "--out", type=Path, default=Path(out), metavar="DIR", help=f"default: {out}"
    )
    parser.add_argument(
        "--json", action="store_true", help="print the result as JSON on stdout"
    )


def start_jax(precision: int) -> None:
    """Set JAX up for a command: fast loops, precision, and a cache of programs."""
    from jaxglider._compile import cache_folder, enable_fast_loops

    enable_fast_loops()
    import jax

    jax.config.update("jax_enable_x64", precision == 64)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(cache_folder() / "programs"))


def _compare(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.runs import compare

    return compare(options)


def _simulate(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.runs import simulate_mission

    return simulate_mission(options)


def _tune(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.tune import tune

    return tune(options)


def _init(options: argparse.Namespace) -> int:
    start_jax(64)
    from jaxglider.config import TEMPLATE
    from jaxglider.io import write_text

    if options.path.exists() and not options.force:
        raise ValueError(f"{options.path} exists; choose another name or use --force.")
    write_text(options.path, TEMPLATE())
    sys.stdout.write(
        f"{options.path} written. Edit it, then: "
        f"jaxglider simulate --config {options.path}\n"
    )
    return OK


def _validate(options: argparse.Namespace) -> int:
    start_jax(64)
    from jaxglider.config import load_mission, start_warnings
    from tuning.progress import note

    mission = load_mission(options.path)
    for warning in start_warnings(mission.loop):
        note(f"warning: {warning}")
    clock = mission.loop.scenario.clock
    sys.stdout.write(
        f"{options.path} is valid: {mission.name}, {mission.controller}, "
        f"{clock.ticks} ticks of {float(clock.dt):g} s.\n"
    )
    return OK


_COMMANDS = {
    "compare": _compare,
    "simulate": _simulate,
    "tune": _tune,
    "init": _init,
    "validate": _validate,
}

if __name__ == "__main__":
    sys.exit(main())
