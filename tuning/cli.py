"""The command line: `jaxglider compare`, `tune`, `sweep` and so on.

Heavy imports wait until a command needs them, so `--help` answers at once. Exit
codes: 0 all well, 1 a run failed, 2 usage or configuration, 3 a stated requirement is
violated, 130 interrupted.
"""

import argparse
import json
import os
import sys
from pathlib import Path

from tuning.options import parser

OK, RUN_FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130


def main(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit code.

    Args:
        arguments: of the command line; those of the process by default, which then
            ends at once if it is interrupted.
    """
    code = _run(arguments)
    if code == INTERRUPTED and arguments is None:
        # JAX interrupted while it compiles crashes when the interpreter is torn down.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def _run(arguments: list[str] | None) -> int:
    top = parser()
    options = top.parse_args(arguments)
    if options.command is None:
        top.print_help()
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


def _complain(text: str) -> None:
    sys.stderr.write(f"jaxglider: {text}\n")


def start_jax(precision: int, *, every_core: bool = False) -> None:
    """Set JAX up for a command: fast loops, precision, and a cache of programs.

    Args:
        precision: 32 or 64 bits.
        every_core: make a device of each core of a CPU, unless the environment says
            how many there are to be (JAX_NUM_CPU_DEVICES or a flag of XLA).
    """
    from jaxglider._compile import cache_folder, enable_fast_loops

    enable_fast_loops()
    import jax

    jax.config.update("jax_enable_x64", precision == 64)
    told = "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", "")
    if every_core and not told and "JAX_NUM_CPU_DEVICES" not in os.environ:
        jax.config.update("jax_num_cpu_devices", _cores())
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(cache_folder() / "programs"))


def _cores() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def _compare(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.runs import compare

    return compare(options)


def _simulate(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.runs import simulate_mission

    return simulate_mission(options)


def _tune(options: argparse.Namespace) -> int:
    # Descent on one device: 16 of 32 members on each of two cores took twice as long.
    start_jax(options.precision, every_core=options.method != "gradient")
    from tuning.tune import tune

    return tune(options)


def _check(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.check import check

    return check(options)


def _sweep(options: argparse.Namespace) -> int:
    start_jax(options.precision, every_core=True)
    from tuning.sweep.hosts import join_hosts

    join_hosts(options)
    from tuning.sweep.command import sweep

    return sweep(options)


def _merge(options: argparse.Namespace) -> int:
    start_jax(_precision_of(options.folders[0]))
    from tuning.sweep.merge import merge

    return merge(options)


def _rerun(options: argparse.Namespace) -> int:
    start_jax(_precision_of(options.folder))
    from tuning.sweep.rerun import rerun

    return rerun(options)


def _precision_of(folder: Path) -> int:
    """The precision of a campaign; what cannot be read is complained of later."""
    try:
        told = json.loads((folder / "campaign.json").read_text())
        return int(told["settings"]["precision"])
    except (OSError, ValueError, KeyError, TypeError):
        return 64


def _export(options: argparse.Namespace) -> int:
    start_jax(64)
    from tuning.export import export

    return export(options)


def _init(options: argparse.Namespace) -> int:
    start_jax(64)
    from jaxglider import _uncertainty, config
    from jaxglider.io import write_text

    kind = "uncertainty" if options.uncertainty else "mission"
    path = options.path or Path(f"{kind}.toml")
    if path.exists() and not options.force:
        raise ValueError(f"{path} exists; choose another name or use --force.")
    template = (_uncertainty if options.uncertainty else config).TEMPLATE
    try:
        write_text(path, template())
    except OSError as error:
        raise OSError(f"{path} cannot be written: {error}.") from error
    use = "tune --uncertainty" if options.uncertainty else "simulate --config"
    sys.stdout.write(f"{path} written. Edit it, then: jaxglider {use} {path}\n")
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


def _cache(options: argparse.Namespace) -> int:
    from tuning.cache import cache

    return cache(options)


def _vehicles(options: argparse.Namespace) -> int:
    start_jax(64)
    from tuning.vehicles import vehicles

    return vehicles(options)


def _trim(options: argparse.Namespace) -> int:
    start_jax(options.precision)
    from tuning.trim import trim

    return trim(options)


_COMMANDS = {
    "compare": _compare,
    "simulate": _simulate,
    "export": _export,
    "tune": _tune,
    "check-gradients": _check,
    "sweep": _sweep,
    "merge": _merge,
    "rerun": _rerun,
    "init": _init,
    "validate": _validate,
    "cache": _cache,
    "vehicles": _vehicles,
    "trim": _trim,
}

if __name__ == "__main__":
    sys.exit(main())
