"""Before against after, member by member, on a set that tuning did not see."""

from typing import Any

import jax
import numpy as np

from jaxglider.files.results import metrics_dict
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from tuning.problem.members import nominal_member
from tuning.problem.objective import CHANNELS
from tuning.problem.problem import TuningProblem
from tuning.reporting.statistics import student_half_width

MEASURES = {"rms_error": "L2[e]", "rms_effort": "L2[U]", "chattering": "L2[dU]"}


class Judge:
    """What a loop is worth on the nominal case and on the held-out test members."""

    def __init__(self, task: TuningProblem) -> None:
        self._task, self._run = task, task.on_members()

    def __call__(self, loop: ClosedLoop) -> tuple[Metrics, Metrics]:
        """Metrics of the nominal case alone, and of the test members; on the host."""
        members = nominal_member(self._task.loop), self._task.test
        nominal, held_out = (jax.device_get(self._run(loop, m)) for m in members)
        return nominal, held_out


def verdict(
    task: TuningProblem,
    before: tuple[Metrics, Metrics],
    after: tuple[Metrics, Metrics],
) -> dict[str, Any]:
    """Before against after on the nominal case and on the held-out test members.

    Args:
        task: what was tuned.
        before: what its `Judge` says of the gains before.
        after: and of those after.
    """
    found = {"before": before, "after": after}
    nominal = {name: both[0] for name, both in found.items()}
    held_out = {name: both[1] for name, both in found.items()}
    waypoints = task.loop.scenario.reference.waypoints
    return {
        "nominal": {
            name: metrics_dict(_one(m, 0), has_waypoints=waypoints is not None)
            for name, m in nominal.items()
        },
        "held_out": {
            channel: {
                measure: paired_means(
                    _column(held_out["before"], channel, measure),
                    _column(held_out["after"], channel, measure),
                )
                for measure in MEASURES
            }
            for channel in CHANNELS
        },
        "counts": {name: _counts(m, waypoints) for name, m in held_out.items()},
    }


def paired_means(before: np.ndarray, after: np.ndarray) -> dict[str, Any]:
    """Paired comparison of one measure on the same members.

    Args:
        before: of each member.
        after: of each member.

    Returns:
        Means, mean difference with its 95 % Student interval (None for one member),
        how many members improved, and how many pairs were finite.
    """
    usable = np.isfinite(before) & np.isfinite(after)
    old, new = before[usable].astype(float), after[usable].astype(float)
    if not len(old):
        return {"pairs": 0, "before": None, "after": None, "better": 0} | {
            "difference": None,
            "interval": None,
        }
    difference = new - old
    interval = None
    if len(old) > 1:
        half = student_half_width(difference)
        interval = [float(difference.mean() - half), float(difference.mean() + half)]
    return {
        "pairs": len(old),
        "before": float(old.mean()),
        "after": float(new.mean()),
        "better": int(np.sum(difference < 0.0)),
        "difference": float(difference.mean()),
        "interval": interval,
    }


def _one(metrics: Metrics, number: int) -> Metrics:
    return jax.tree.map(lambda x: x[number], metrics)


def _column(metrics: Metrics, channel: str, measure: str) -> np.ndarray:
    return np.asarray(getattr(getattr(metrics.channels, channel), measure))


def _counts(metrics: Metrics, waypoints: int | None) -> dict[str, int]:
    outside = sum(_column(metrics, c, "time_outside_funnel") > 0.0 for c in CHANNELS)
    counts = {
        "members": len(np.asarray(metrics.finite)),
        "not_finite": int(np.sum(~np.asarray(metrics.finite))),
        "capsized": int(np.sum(np.asarray(metrics.capsized))),
        "outside_funnel": int(np.sum(outside > 0)),
    }
    if waypoints is not None:
        reached = np.asarray(metrics.waypoints_reached)
        counts["unfinished"] = int(np.sum(reached < waypoints))
    return counts
