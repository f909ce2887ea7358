"""The ledger: in how many members each assumption of the theorem held.

| assumption | holds in a member where |
|---|---|
| `inside-at-restart` | every error is inside the law's own funnel when that restarts |
| `within-linear-tail` | no error passes the share of its edge where T gets straight |
| `unsaturated` | no actuator is ever short of its command |
| `disturbance-rate` | the observer's ι₁, ι₂ are in their set for the fastest change |
| `observer-settled` | while any error has to be settled, |d̂ − d| ≤ 0.1 max |d| |
| `tick` | the tick is below 1 over the law's fastest rate about zero error |
| `smoothing` | with δ/10 instead of δ, no L2[e] differs by more than 5 % |

What a law does not assume is not in its ledger.
"""

import dataclasses
from typing import Any

import jax
import numpy as np

from jaxglider.control import SMC
from jaxglider.control.observer import FixedTimeObserver
from jaxglider.signals import CHANNELS, map_fields
from jaxglider.simulation.checks.law_rates import fastest_rate
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from tuning.reporting.statistics import LEVEL, probability
from tuning.reporting.tables import markdown_table
from tuning.reporting.witness import Witness

SETTLED_SHARE = 0.1
"""Share of the largest disturbance that a settled observer may be off by."""
SMOOTHING_SHARE = 0.05
"""Share by which an L2[e] may change with a tenth of the smoothing."""

TITLES = {
    "inside-at-restart": "errors inside the law's funnel at each restart",
    "within-linear-tail": "transformed errors within the linear tail's edge",
    "unsaturated": "actuators unsaturated",
    "disturbance-rate": "disturbance no faster than the observer's set allows",
    "observer-settled": "observer settled before the required time",
    "tick": "tick below 1 over the fastest rate of the law",
    "smoothing": "a tenth of the smoothing changes nothing",
}
"""Assumptions by name, in words."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """One assumption, and how often it held.

    Attributes:
        holds: number and share of the members, with the exact interval of the
            probability: `k`, `n`, `p`, `interval`.
        detail: numbers that say more, by name.
    """

    holds: dict[str, Any]
    detail: dict[str, float]


def ledger(
    loop: ClosedLoop,
    metrics: Metrics,
    witness: Witness,
    smoother: Metrics | None = None,
    level: float = LEVEL,
) -> dict[str, Entry]:
    """The ledger of a closed loop on some members; of a failed run nothing held.

    Args:
        loop: closed loop that was flown.
        metrics: metrics of the members, on the host.
        witness: measures seen in the same runs.
        smoother: metrics of the same members with a tenth of the smoothing.
        level: level of confidence.
    """
    finite = np.asarray(metrics.finite)
    held = _of_the_funnel(loop, witness)
    saturated = np.stack([_of(metrics, c, "time_saturated") for c in CHANNELS])
    shares = saturated[:, finite].mean(axis=1) if finite.any() else np.full(3, np.nan)
    held["unsaturated"] = (
        np.all(saturated == 0.0, axis=0),
        {f"mean_share_{c}": float(x) for c, x in zip(CHANNELS, shares, strict=True)},
    )
    held |= _of_the_observer(loop, witness)
    rate = fastest_rate(loop.controller)
    if rate is not None:
        product = float(rate) * float(loop.scenario.clock.dt)
        detail = {"fastest_rate_1_s": float(rate), "tick_times_rate": product}
        held["tick"] = np.full(len(finite), product < 1.0), detail
    if smoother is not None:
        held["smoothing"] = _smoothed(metrics, smoother)
    return {
        name: Entry(probability(held[name][0] & finite, level), held[name][1])
        for name in TITLES
        if name in held
    }


def with_smoothing(loop: ClosedLoop, factor: float) -> ClosedLoop | None:
    """The loop with another smoothing of law and observer; None where it has none.

    Args:
        loop: closed loop.
        factor: factor on each smoothing.
    """
    found = False

    def scaled(path: Any, leaf: Any) -> Any:
        nonlocal found
        if getattr(path[-1], "name", "") != "smoothing":
            return leaf
        found = True
        return leaf * factor

    law, observer = jax.tree_util.tree_map_with_path(
        scaled, (loop.controller, loop.observer)
    )
    if not found:
        return None
    return dataclasses.replace(loop, controller=law, observer=observer)


def to_dict(entries: dict[str, Entry]) -> dict[str, Any]:
    """Plain numbers, as they stand in JSON."""
    return {name: dataclasses.asdict(entry) for name, entry in entries.items()}


def text_ledger(entries: dict[str, Any]) -> list[str]:
    """Lines for a terminal, from plain numbers."""
    lines = ["assumptions of the theorem, as the runs show them:"]
    for name, entry in entries.items():
        lines.append(f"  {TITLES[name]:<58}{_counted(entry['holds'])}")
    return lines


def markdown_ledger(entries: dict[str, Any]) -> list[str]:
    """A section of a report, from plain numbers."""
    rows = [
        [TITLES[name], _counted(entry["holds"]), _detailed(entry["detail"])]
        for name, entry in entries.items()
    ]
    return markdown_table(["assumption", "holds", ""], rows, 2)


def _counted(holds: dict[str, Any]) -> str:
    low, high = holds["interval"]
    return f"{holds['k']} of {holds['n']} [{low:.3g}, {high:.3g}]"


def _detailed(detail: dict[str, float]) -> str:
    return ", ".join(f"{name} {x:.3g}" for name, x in detail.items())


def _of(metrics: Metrics, channel: str, measure: str) -> np.ndarray:
    return np.asarray(getattr(getattr(metrics.channels, channel), measure))


def _stacked(container: Any) -> np.ndarray:
    return np.stack([np.asarray(x) for x in vars(container).values()])


def _of_the_funnel(loop: ClosedLoop, witness: Witness) -> dict[str, Any]:
    """Assumptions of a law that transforms its errors."""
    funnel = loop.controller.funnel
    if funnel is None or isinstance(loop.controller, SMC):
        return {}
    tails = _stacked(map_fields(lambda t: t.tail, funnel.transformation))[:, None]
    restart, nearness = _stacked(witness.at_restart), _stacked(witness.nearness)
    return {
        "inside-at-restart": (
            np.all(restart < 1.0, axis=0),
            _largest("worst", CHANNELS, restart),
        ),
        "within-linear-tail": (
            np.all(nearness <= tails, axis=0),
            _largest("worst", CHANNELS, nearness),
        ),
    }


def _of_the_observer(loop: ClosedLoop, witness: Witness) -> dict[str, Any]:
    """Assumptions of the fixed-time observer, and on it."""
    observer = loop.observer
    if not isinstance(observer, FixedTimeObserver):
        return {}
    rates = _stacked(witness.disturbance_rate)
    first = _stacked(observer.proportional)[:, None]
    second = _stacked(observer.integral)[:, None]
    axes = tuple(vars(witness.disturbance))
    largest, late = _stacked(witness.disturbance), _stacked(witness.late_error)
    off = late / np.maximum(largest, 1e-12)
    return {
        "disturbance-rate": (
            np.all(observer_set_holds(first, second, rates), axis=0),
            _largest("largest_rate", axes, rates),
        ),
        "observer-settled": (
            np.all(late <= SETTLED_SHARE * largest, axis=0),
            _largest("worst_share", axes, off),
        ),
    }


def observer_set_holds(
    proportional: np.ndarray, integral: np.ndarray, rate: np.ndarray
) -> np.ndarray:
    """Whether ι₁ and ι₂ are in the published set for a rate |d'| ≤ D.

    ι₂ > ι₁²/4 + 4D²/ι₁² for ι₁ ≤ 2√D, ι₂ > D beyond.

    Args:
        proportional: ι₁.
        integral: ι₂.
        rate: D [N/s or N m/s].
    """
    square = proportional**2
    low = integral > square / 4.0 + 4.0 * rate**2 / square
    return np.where(square > 4.0 * rate, integral > rate, low)


def _smoothed(metrics: Metrics, smoother: Metrics) -> tuple[np.ndarray, dict[str, Any]]:
    change = np.stack(
        [
            np.abs(_of(smoother, c, "rms_error") - _of(metrics, c, "rms_error"))
            / np.maximum(_of(metrics, c, "rms_error"), 1e-12)
            for c in CHANNELS
        ]
    )
    holds = np.all(change <= SMOOTHING_SHARE, axis=0)
    return holds, _largest("largest_change", CHANNELS, change)


def _largest(word: str, names: Any, values: np.ndarray) -> dict[str, float]:
    """The largest of all members of each row, by name."""
    return {
        f"{word}_{name}": float(row[~np.isnan(row)].max(initial=0.0))
        for name, row in zip(names, values, strict=True)
    }
