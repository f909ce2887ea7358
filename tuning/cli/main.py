"""The command line: `jaxglider compare`, `tune`, `sweep` and so on.

Heavy imports wait until a command needs them, so `--help` answers at once. Exit
codes: 0 all well, 1 a run failed, 2 usage or configuration, 3 a stated requirement is
violated, 130 interrupted.
"""

import argparse
import io
import json
import os
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from tuning.cli.parser import parser
from tuning.cli.session.jax_setup import start_jax
from tuning.reporting.exit_codes import INTERRUPTED, OK, RUN_FAILED, USAGE


def main(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit code.

    Args:
        arguments: words of the command line; those of the process by default, which
            then ends at once if it is interrupted.
    """
    code = _run(arguments)
    if code == INTERRUPTED and arguments is None:
        # JAX interrupted while it compiles crashes when the interpreter is torn down.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def _run(arguments: list[str] | None) -> int:
    _print_anything()
    top = parser()
    options = top.parse_args(arguments)
    if options.command is None:
        top.print_help()
        return USAGE
    if not options.debug:
        # What XLA says of itself while it compiles helps nobody who flies gliders.
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    try:
        with _output(options):
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
    except RuntimeError as error:
        # JAX's own error for this cannot be named without importing JAX.
        if options.debug or "RESOURCE_EXHAUSTED" not in str(error):
            raise
        _complain(
            "out of memory: shorten the run or lengthen the tick "
            f"({str(error).splitlines()[0]})"
        )
        return RUN_FAILED
    except (OSError, ValueError) as error:
        if options.debug:
            raise
        _complain(str(error))
        return USAGE


def _output(options: argparse.Namespace) -> AbstractContextManager[None]:
    """The folder that a command is told to write to, kept for it alone."""
    out = getattr(options, "out", None)
    if out is None:
        return nullcontext()
    from tuning.reporting.output_folder import writing_to

    host = getattr(options, "host", 0)
    # The hosts of one campaign may share a disk: each but the first has its own folder.
    return writing_to(out / f"host-{host}" if host else out)


def _print_anything() -> None:
    """Let a terminal that lacks a letter show a question mark, not end the command."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def _complain(text: str) -> None:
    sys.stderr.write(f"jaxglider: {text}\n")


def _compare(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.cli.commands.compare import compare

    return compare(options)


def _simulate(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.cli.commands.simulate import simulate_mission

    return simulate_mission(options)


def _tune(options: argparse.Namespace) -> int:
    # Descent on one device: 16 of 32 members on each of two cores took twice as long.
    start_jax(options.precision, every_core=options.method != "gradient")
    from tuning.cli.commands.tune import tune

    return tune(options)


def _check(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.cli.commands.check_gradients import check

    return check(options)


def _sweep(options: argparse.Namespace) -> int:
    start_jax(options.precision, every_core=True)
    from tuning.campaign.run.hosts import join_hosts

    join_hosts(options)
    from tuning.cli.commands.sweep import sweep

    return sweep(options)


def _worst(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.cli.commands.sweep import worst

    return worst(options)


def _merge(options: argparse.Namespace) -> int:
    start_jax(_precision_of(options.folders[0]))
    from tuning.cli.commands.merge import merge

    return merge(options)


def _rerun(options: argparse.Namespace) -> int:
    start_jax(_precision_of(options.folder))
    from tuning.cli.commands.rerun import rerun

    return rerun(options)


def _precision_of(folder: Path) -> int:
    """The precision of a campaign; what cannot be read is complained of later."""
    try:
        told = json.loads((folder / "campaign.json").read_text(encoding="utf-8"))
        return int(told["settings"]["precision"])
    except (OSError, ValueError, KeyError, TypeError):
        return 64


def _export(options: argparse.Namespace) -> int:
    start_jax(64)
    from tuning.cli.commands.export import export

    return export(options)


def _init(options: argparse.Namespace) -> int:
    start_jax(64)
    from tuning.cli.commands.templates import init

    return init(options)


def _settings(options: argparse.Namespace) -> int:
    from tuning.cli.commands.templates import settings

    return settings(options)


def _validate(options: argparse.Namespace) -> int:
    start_jax(64)
    from tuning.cli.commands.templates import validate

    return validate(options)


def _cache(options: argparse.Namespace) -> int:
    from tuning.cli.commands.cache import cache

    return cache(options)


def _missions(options: argparse.Namespace) -> int:
    from tuning.cli.commands.vehicles import missions

    return missions(options)


def _vehicles(options: argparse.Namespace) -> int:
    start_jax(64)
    from tuning.cli.commands.vehicles import vehicles

    return vehicles(options)


def _trim(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.cli.commands.trim import trim

    return trim(options)


def _record(options: argparse.Namespace) -> int:
    start_jax(64)
    from tuning.cli.commands.identification.record import record

    return record(options)


def _fit(options: argparse.Namespace) -> int:
    start_jax(64)
    from tuning.cli.commands.identification.fit import fit

    return fit(options)


_COMMANDS = {
    "compare": _compare,
    "simulate": _simulate,
    "export": _export,
    "tune": _tune,
    "check-gradients": _check,
    "sweep": _sweep,
    "worst": _worst,
    "merge": _merge,
    "rerun": _rerun,
    "init": _init,
    "validate": _validate,
    "settings": _settings,
    "cache": _cache,
    "missions": _missions,
    "vehicles": _vehicles,
    "trim": _trim,
    "record": _record,
    "fit": _fit,
}
