"""The peer in C: compiled with the system's compiler when it is first asked for."""

import ctypes
import functools
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from peers.problem import METRICS, Problem

SOURCE = Path(__file__).with_name("closed_loop.c")
COMPILER = os.environ.get("CC", "gcc")
FAST = (
    "-O3",
    "-march=native",
    "-ffast-math",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-mprefer-vector-width=512",
    "-fschedule-insns",
    "-fsched-pressure",
    "-mrecip=!vec-div,!vec-sqrt",
)
PLAIN = ("-O3", "-march=native", "-ffast-math", "-DPLAIN")
LANES = 16
"""Members side by side: one AVX-512 register in single precision, and the fastest."""


class CompilerError(Exception):
    """There is no C compiler, or it refused the source or a flag."""


class _Schedule(ctypes.Structure):
    _fields_ = (
        ("start", ctypes.c_void_p),
        ("gliding_angle", ctypes.c_void_p),
        ("heading", ctypes.c_void_p),
        ("depth_rate", ctypes.c_void_p),
        ("segments", ctypes.c_int64),
    )


@functools.cache
def library(flags: Sequence[str], precision: int, lanes: int) -> ctypes.CDLL:
    """The compiled program.

    Raises:
        CompilerError: no compiler, or it failed.
    """
    compiler = shutil.which(COMPILER)
    if compiler is None:
        raise CompilerError(f"no C compiler: {COMPILER!r} was not found.")
    kind = ("-DREAL=double", "-DDOUBLE") if precision == 64 else ("-DREAL=float",)
    with tempfile.TemporaryDirectory() as folder:
        target, part = Path(folder) / "closed_loop.so", Path(folder) / "closed_loop.o"
        _run(
            *(compiler, "-std=gnu11", *flags, *kind, f"-DLANES={lanes}"),
            *("-fopenmp", "-fPIC", "-c", "-o", part, SOURCE),
        )
        # Linked with -ffast-math, it would flush subnormals of the whole process.
        _run(compiler, "-fopenmp", "-shared", "-o", target, part, "-lm")
        return ctypes.CDLL(str(target))


def _run(*command: str | Path) -> None:
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    if done.returncode != 0:
        raise CompilerError(f"{COMPILER} failed: {done.stderr.strip()}")


def evaluate(
    problem: Problem,
    parameters: np.ndarray,
    ticks: int,
    cores: int = 1,
    flags: Sequence[str] = FAST,
) -> np.ndarray:
    """Metrics of all members; see `peers`."""
    kind = parameters.dtype
    members = parameters.shape[1]
    lanes = 1 if members == 1 else LANES
    program = library(tuple(flags), 8 * kind.itemsize, lanes)
    shared = np.concatenate(list(problem.shared.values()))
    sea = np.ascontiguousarray(problem.sea[:, : ticks + 1])
    metrics = np.empty((len(METRICS), members), kind)
    arrays = [shared, *problem.schedule.values(), sea, parameters]
    if any(a.dtype != kind or not a.flags.c_contiguous for a in arrays):
        raise ValueError(f"the C peer needs contiguous arrays, all of {kind}.")
    columns = [a.ctypes.data for a in problem.schedule.values()]
    schedule = _Schedule(*columns, len(problem.schedule["start"]))
    failed = program.evaluate(
        ctypes.c_void_p(shared.ctypes.data),
        ctypes.byref(schedule),
        ctypes.c_void_p(sea.ctypes.data),
        ctypes.c_void_p(parameters.ctypes.data),
        ctypes.c_int64(members),
        ctypes.c_int64(ticks),
        ctypes.c_int(cores),
        ctypes.c_void_p(metrics.ctypes.data),
    )
    if failed:
        raise MemoryError(f"no memory for the tables of {ticks} ticks.")
    return metrics
