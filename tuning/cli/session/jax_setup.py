"""JAX set up for a command: precision, devices, and a cache of programs."""

import gc
import os
from pathlib import Path


def start_jax(precision: int, *, every_core: bool = False) -> None:
    """Set JAX up for a command: fast loops, precision, and a cache of programs.

    Args:
        precision: 32 or 64 bits.
        every_core: make a device of each core of a CPU, unless the environment says
            how many there are to be (JAX_NUM_CPU_DEVICES or a flag of XLA).
    """
    from jaxglider.core.compiler import cache_folder, enable_fast_loops

    enable_fast_loops()
    import jax

    from jaxglider.core.kept.programs import keep_programs

    # Tracing makes objects by the million; looking through all that were imported, each
    # few hundred of them, took a sixth of its time and found nothing.
    gc.freeze()
    gc.set_threshold(20_000)
    jax.config.update("jax_enable_x64", precision == 64)
    told = "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", "")
    if every_core and not told and "JAX_NUM_CPU_DEVICES" not in os.environ:
        jax.config.update("jax_num_cpu_devices", _cores())
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        folder = cache_folder()
        if folder is None or not _can_be_written(folder / "programs"):
            from tuning.reporting.console import note

            why = f"{folder} cannot be written" if folder else "there is no home folder"
            note(
                f"no cache of compiled programs: {why}. Set XDG_CACHE_HOME to have one."
            )
        else:
            jax.config.update("jax_compilation_cache_dir", str(folder / "programs"))
            keep_programs(folder / "traces")
    if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
        # Small programs too: a hundred of them take seconds of every start.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def _can_be_written(folder: Path) -> bool:
    """Whether a folder is there, or can be made, for files of this process."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _cores() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1
