"""The peer in NumPy: every operation on a row over all members."""

from typing import Any

import numpy as np

from peers.formulas import Dialect
from peers.problem import Problem
from peers.stepping import constants, empty, make_plan, make_tick, metrics_of


def _as_it_is(function: Any) -> Any:
    return function


def _advance(out: np.ndarray, x: np.ndarray, step: Any, slope: np.ndarray) -> None:
    np.add(x, step * slope, out=out)


_NUMPY = Dialect(_as_it_is, np.where, _advance)


def evaluate(
    problem: Problem, parameters: np.ndarray, ticks: int, cores: int = 1
) -> np.ndarray:
    """Metrics of all members; see `peers`. NumPy has one core only."""
    del cores
    tick = make_tick(_NUMPY, parameters.dtype.type)
    task, funnels, sea = make_plan(problem, ticks)
    carried = empty(problem, parameters.shape[1:])
    known = constants(problem)
    for k in range(ticks):
        tick(k == 0, task[k], funnels[k], sea[k], known, parameters, carried)
    return metrics_of(carried[5], carried[0], ticks)
