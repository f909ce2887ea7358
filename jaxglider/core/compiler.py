"""Compiler options that make a scan over control ticks fast on a CPU.

By default XLA runs the body of a loop as some hundred calls of small kernels. Told
that every loop is small, it emits the whole time loop as one function: a single rollout
then runs ten to twenty times as fast. The option is internal to XLA and may change, so
it is set here alone, is probed in a child process on versions it was not tried on, and
is left out with a notice where it does not work.

It travels in the environment variable XLA_FLAGS, which XLA reads at its first use. The
library never sets it by itself.
"""

import contextlib
import functools
import hashlib
import importlib.metadata
import os
import platform
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import jax

set_xla_metadata: Any = None
with contextlib.suppress(ImportError):  # experimental: a version may not have it
    from jax.experimental.xla_metadata import set_xla_metadata

F = TypeVar("F", bound=Callable[..., Any])

FAST_LOOP_FLAGS = (
    "--xla_backend_extra_options="
    "xla_cpu_small_while_loop_byte_threshold=1000000000,"
    "xla_cpu_disable_loop_unrolling=true",
    "--xla_cpu_prefer_vector_width=512",
)
SWITCH = "JAXGLIDER_FAST_LOOPS"
_TRIED = ("0.10.", "0.12.")
_PROBE = "import jax; jax.jit(lambda x: x + 1)(1.0).block_until_ready()"


def enable_fast_loops() -> bool:
    """Set the options, unless they are switched off or do not work here.

    Call it before the first computation of JAX. A user's own XLA_FLAGS are kept; where
    they already set one of these options, theirs wins. Set the environment variable
    JAXGLIDER_FAST_LOOPS=0 to switch the options off.

    Returns:
        Whether the options are in force. If not, everything works, only slower.
    """
    if os.environ.get(SWITCH, "1") == "0":
        return False
    if _backend_started():
        warnings.warn(
            "enable_fast_loops() came after JAX's first computation and has no effect; "
            "call it first thing in the program.",
            stacklevel=2,
        )
        return False
    if not _works():
        warnings.warn(
            "this version of XLA refuses the fast-loop options; running without them.",
            stacklevel=2,
        )
        return False
    os.environ["XLA_FLAGS"] = _merged(os.environ.get("XLA_FLAGS", ""))
    return True


def _merged(own_flags: str) -> str:
    """A user's flags with ours added; where both set one option, theirs is kept."""
    flags = own_flags.split()
    names = [flag.split("=", 1)[0] for flag in flags]
    for flag in FAST_LOOP_FLAGS:
        name, values = flag.split("=", 1)
        if name not in names:
            flags.append(flag)
            continue
        at = names.index(name)
        theirs = flags[at].split("=", 1)[-1].split(",")
        set_by_them = {value.split("=")[0] for value in theirs}
        if "=" in values:
            ours = [v for v in values.split(",") if v.split("=")[0] not in set_by_them]
            flags[at] = ",".join([flags[at], *ours])
    return " ".join(flags)


def cache_folder() -> Path | None:
    """Folder of compiled programs and probes, for this user and processor.

    None for a user without a home folder, as in many containers.
    """
    root = os.environ.get("XDG_CACHE_HOME")
    try:
        home = Path(root) if root else Path.home() / ".cache"
    except RuntimeError:
        return None
    return home / "jaxglider" / _processor()


def _processor() -> str:
    """A short name of the processor: programs compiled for one may crash on another."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        traits = sorted({x for x in lines if x.startswith(("model name", "flags"))})
    except OSError:
        traits = [platform.processor()]
    digest = hashlib.sha256("\n".join(traits).encode()).hexdigest()[:12]
    return f"{platform.machine()}-{digest}"


def _backend_started() -> bool:
    if "jax" not in sys.modules:
        return False
    try:
        from jax._src import xla_bridge

        return bool(xla_bridge.backends_are_initialized())
    except (ImportError, AttributeError):
        return False


def _works() -> bool:
    version = importlib.metadata.version("jaxlib")
    if version.startswith(_TRIED):
        return True
    folder = cache_folder()
    verdict = folder / f"fast-loops-{version}" if folder else None
    if verdict and verdict.exists():
        return verdict.read_text(encoding="utf-8") == "yes"
    environment = {**os.environ, "XLA_FLAGS": " ".join(FAST_LOOP_FLAGS)}
    probe = subprocess.run(
        [sys.executable, "-c", _PROBE],
        env=environment,
        capture_output=True,
        check=False,
    )
    works = probe.returncode == 0
    if verdict:
        with contextlib.suppress(OSError):
            verdict.parent.mkdir(parents=True, exist_ok=True)
            verdict.write_text("yes" if works else "no", encoding="utf-8")
    return works


def not_inlined(function: F) -> F:
    """A function that XLA keeps apart: its results are computed once, then used.

    XLA for CPUs otherwise merges a function into its callers and copies its formulas
    into all that uses them. Elsewhere, and where JAX cannot say it, nothing changes.
    """
    if set_xla_metadata is None:
        return function

    @functools.wraps(function)
    def merged(*arguments: Any) -> Any:
        with set_xla_metadata(inlineable=None):
            return function(*arguments)

    compiled = jax.jit(merged)

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        if jax.default_backend() != "cpu":
            return function(*arguments)
        with set_xla_metadata(inlineable="false"):
            return compiled(*arguments)

    return cast(F, call)
