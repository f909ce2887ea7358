"""The peer in numba: one member after the other, members spread over threads."""

import functools
from typing import Any

import numba
import numpy as np

from peers.formulas import Dialect
from peers.problem import Problem
from peers.stepping import constants, empty, make_plan, make_tick, metrics_of

_compiled = numba.njit(fastmath=True, error_model="numpy")


@_compiled
def _advance(out: Any, x: Any, step: Any, slope: Any) -> None:
    for i in range(out.shape[0]):
        out[i] = x[i] + step * slope[i]


@_compiled
def _where(condition: Any, a: Any, b: Any) -> Any:
    return a if condition else b


_NUMBA = Dialect(_compiled, _where, _advance)


@functools.cache
def _program(kind: type) -> Any:
    tick = make_tick(_NUMBA, kind)

    @numba.njit(fastmath=True, error_model="numpy", parallel=True)
    def run(task, funnels, sea, known, parameters, start, sums, last):
        for lane in numba.prange(parameters.shape[1]):
            carried = (
                start[0].copy(),
                start[1].copy(),
                start[2].copy(),
                start[3].copy(),
                start[4].copy(),
                start[5].copy(),
                start[6].copy(),
                start[7].copy(),
                start[8].copy(),
            )
            own = parameters[:, lane].copy()
            for k in range(task.shape[0]):
                tick(k == 0, task[k], funnels[k], sea[k], known, own, carried)
            sums[:, lane] = carried[5]
            last[:, lane] = carried[0]

    return run


def evaluate(
    problem: Problem, parameters: np.ndarray, ticks: int, cores: int = 1
) -> np.ndarray:
    """Metrics of all members; see `peers`."""
    numba.set_num_threads(min(cores, numba.config.NUMBA_NUM_THREADS))
    kind = parameters.dtype
    start = empty(problem, ())
    sums = np.empty((len(start[5]), parameters.shape[1]), kind)
    last = np.empty((12, parameters.shape[1]), kind)
    plan = make_plan(problem, ticks)
    _program(kind.type)(*plan, constants(problem), parameters, start, sums, last)
    return metrics_of(sums, last, ticks)
