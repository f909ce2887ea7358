"""Before against after, member by member, on a set that tuning did not see."""

import dataclasses
from operator import attrgetter
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxglider.files.results import metrics_dict
from jaxglider.guidance.phases import COMPLETED, STATUSES
from jaxglider.signals import CHANNELS
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from jaxglider.simulation.specification import Specification
from tuning.problem.members import and_nominal, nominal_member
from tuning.problem.problem import TuningProblem, assess_members
from tuning.reporting.ledger import Entry, ledger, with_smoothing
from tuning.reporting.statistics import student_half_width
from tuning.reporting.tables import RMS_COMMAND, RMS_ERROR, RMS_STEP
from tuning.reporting.violations import broken, violations

MEASURES = {
    "rms_error": RMS_ERROR,
    "rms_effort": RMS_COMMAND,
    "chattering": RMS_STEP,
    "travel": "travel",
}
"""Measures of a channel that are compared, and their names in tables."""


@dataclasses.dataclass(frozen=True)
class PairedMeans:
    """One measure of one channel before and after, on the same members.

    Attributes:
        pairs: number of members that were finite before and after.
        before: mean before; None without a pair.
        after: mean after; None without a pair.
        better: number of members on which it fell.
        difference: mean of after − before; None without a pair.
        interval: 95 % Student interval of the difference; None for one pair.
    """

    pairs: int
    before: float | None
    after: float | None
    better: int
    difference: float | None
    interval: list[float] | None


@dataclasses.dataclass(frozen=True)
class Counts:
    """Numbers of members that met with trouble.

    Attributes:
        members: number of members.
        not_finite: number of runs that became non-finite.
        capsized: number that rolled past 90 degrees.
        outside_funnel: number that left a specified funnel at some time.
        unfinished: number whose mission did not come to its end, or that missed a
            waypoint; None without a course or yos.
        ends: numbers of those by the end of their mission, where yos are flown.
        broken: number that broke any part of the specification; each part by its name.
    """

    members: int
    not_finite: int
    capsized: int
    outside_funnel: int
    unfinished: int | None = None
    ends: dict[str, int] = dataclasses.field(default_factory=dict)
    broken: dict[str, int] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Result of tuning; every table has the keys `before` and `after`.

    Attributes:
        nominal: metrics of the nominal case as plain numbers.
        held_out: comparison of each measure of `MEASURES`, by channel.
        counts: troubles of the held-out members.
        ledger: assumptions of the theorem on the held-out members.
    """

    nominal: dict[str, dict[str, Any]]
    held_out: dict[str, dict[str, PairedMeans]]
    counts: dict[str, Counts]
    ledger: dict[str, dict[str, Entry]] = dataclasses.field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, as they stand in tune.json."""
        tables = dataclasses.asdict(self)
        for counts in tables["counts"].values():
            for key in ("unfinished", "ends"):
                if counts[key] in (None, {}):
                    del counts[key]
        return tables


class Judged(NamedTuple):
    """A loop on the nominal case and on the held-out test members, on the host.

    Attributes:
        nominal: metrics of the nominal case alone.
        held_out: metrics of the test members.
        ledger: assumptions of the theorem on these.
    """

    nominal: Metrics
    held_out: Metrics
    ledger: dict[str, Entry]


class Judge:
    """Judge of a loop on the nominal case and on the held-out test members."""

    def __init__(self, problem: TuningProblem) -> None:
        self._problem = problem

    def __call__(self, loop: ClosedLoop) -> Judged:
        """Metrics of the nominal case and of the test members, and their ledger."""
        nominal, (held_out, witness) = self._runs(loop)
        smoother, smooth = with_smoothing(loop, 0.1), None
        if smoother is not None:
            _, (smooth, _) = self._runs(smoother)
        return Judged(nominal, held_out, ledger(loop, held_out, witness, smooth))

    def metrics(self, loop: ClosedLoop) -> tuple[Metrics, Metrics]:
        """Metrics of the nominal case alone, and of the test members; on the host."""
        nominal, (held_out, _) = self._runs(loop)
        return nominal, held_out

    def _runs(self, loop: ClosedLoop) -> tuple[Metrics, tuple[Metrics, Any]]:
        """Metrics of the nominal case; metrics and witness of the test members."""
        test = self._problem.test
        together = and_nominal(test, loop)
        if together is None:
            (nominal, _), held_out = (
                jax.device_get(assess_members(loop, members))
                for members in (nominal_member(loop), test)
            )
            return nominal, held_out
        every = jax.device_get(assess_members(loop, together))
        nominal, _ = jax.tree.map(lambda x: x[-1:], every)
        return nominal, jax.tree.map(lambda x: x[:-1], every)


def compare_held_out(
    problem: TuningProblem,
    before: Judged,
    after: Judged,
) -> Verdict:
    """Before against after on the nominal case and on the held-out test members.

    Args:
        problem: problem that was solved.
        before: judgement of its `Judge` on the gains before.
        after: judgement on those after.
    """
    both = {"before": before, "after": after}
    waypoints = problem.loop.scenario.reference.waypoints
    return Verdict(
        nominal={
            name: metrics_dict(
                _one(one.nominal, 0), has_waypoints=waypoints is not None
            )
            for name, one in both.items()
        },
        held_out={
            channel: {
                measure: paired_means(
                    _column(before.held_out, channel, measure),
                    _column(after.held_out, channel, measure),
                )
                for measure in MEASURES
            }
            for channel in CHANNELS
        },
        counts={
            name: _counts(one.held_out, waypoints, problem.loop.scenario.specification)
            for name, one in both.items()
        },
        ledger={name: one.ledger for name, one in both.items()},
    )


def paired_means(before: np.ndarray, after: np.ndarray) -> PairedMeans:
    """Paired comparison of one measure on the same members.

    Args:
        before: measure of each member before.
        after: measure of each member after.
    """
    usable = np.isfinite(before) & np.isfinite(after)
    old, new = before[usable].astype(float), after[usable].astype(float)
    if not len(old):
        return PairedMeans(
            pairs=0, before=None, after=None, better=0, difference=None, interval=None
        )
    difference = new - old
    interval = None
    if len(old) > 1:
        half = student_half_width(difference)
        interval = [float(difference.mean() - half), float(difference.mean() + half)]
    return PairedMeans(
        pairs=len(old),
        before=float(old.mean()),
        after=float(new.mean()),
        better=int(np.sum(difference < 0.0)),
        difference=float(difference.mean()),
        interval=interval,
    )


def _one(metrics: Metrics, number: int) -> Metrics:
    return jax.tree.map(lambda x: x[number], metrics)


def _column(metrics: Metrics, channel: str, measure: str) -> np.ndarray:
    return np.asarray(getattr(getattr(metrics.channels, channel), measure))


def _counts(
    metrics: Metrics, waypoints: int | None, specification: Specification | None
) -> Counts:
    outside = sum(_column(metrics, c, "time_outside_funnel") > 0.0 for c in CHANNELS)
    unfinished, ends = None, {}
    if metrics.status is not None:
        number = np.asarray(metrics.status)
        unfinished = int(np.sum(number != COMPLETED))
        ends = {n: int(np.sum(number == k)) for k, n in enumerate(STATUSES)}
    elif waypoints is not None:
        reached = np.asarray(metrics.waypoints_reached)
        unfinished = int(np.sum(reached < waypoints))
    return Counts(
        members=len(np.asarray(metrics.finite)),
        not_finite=int(np.sum(~np.asarray(metrics.finite))),
        capsized=int(np.sum(np.asarray(metrics.capsized))),
        outside_funnel=int(np.sum(outside > 0)),
        unfinished=unfinished,
        ends={n: k for n, k in ends.items() if k and n != STATUSES[COMPLETED]},
        broken=_broken(metrics, specification),
    )


def _broken(metrics: Metrics, specification: Specification | None) -> dict[str, int]:
    """Numbers of members that broke any part of the specification, and each part."""

    def column(name: str) -> np.ndarray:
        where = f"channels.{name}" if "." in name else name
        return np.asarray(attrgetter(where)(metrics))

    flags = violations(column, ~np.asarray(metrics.finite), specification)
    counts = {name: int(np.sum(flag)) for name, flag in flags.items()}
    return {"any": int(np.sum(broken(flags))), **counts}
