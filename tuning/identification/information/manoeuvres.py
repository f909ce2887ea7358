"""Manoeuvres to learn more by: the one that would narrow each interval most.

The fitted glider is flown once more through the record's dives, changed in one way: the
Fisher information of that flight, with the noise that the record showed, is added to
that of the record, and the interval of each number follows.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from tuning.identification.information.least_squares import information
from tuning.identification.information.likelihood import SearchedStage

Change = Callable[[Any], Any]
"""Change of the inputs of a simulation, `Windows`."""


@dataclasses.dataclass(frozen=True)
class Advice:
    """Gain of a manoeuvre: how much narrower the intervals would be after it.

    Attributes:
        manoeuvre: manoeuvre, in words.
        shares: standard deviation after it over that before it, by number.
    """

    manoeuvre: str
    shares: Mapping[str, float]


def _about_middle(values: jax.Array, factor: float) -> jax.Array:
    middle = jnp.mean(values)
    return middle + factor * (values - middle)


def _pitched(factor: float) -> Change:
    def change(w: Any) -> Any:
        return dataclasses.replace(
            w,
            pitch=jnp.clip(factor * w.pitch, -1.2, 1.2),
            pitch_rate=factor * w.pitch_rate,
            mass_position=_about_middle(w.mass_position, factor),
        )

    return change


def _ballasted(factor: float) -> Change:
    def change(w: Any) -> Any:
        return dataclasses.replace(w, ballast=_about_middle(w.ballast, factor))

    return change


def _rolled(w: Any) -> Any:
    return dataclasses.replace(w, mass_angle=1.5 * w.mass_angle)


def _deeper(w: Any) -> Any:
    return dataclasses.replace(w, pressure=3.0 * w.pressure)


SAME = "the same dives once more"
MANOEUVRES: dict[str, Change] = {
    SAME: lambda w: w,
    "dives and climbs 1.4 times as steep": _pitched(1.4),
    "dives and climbs 0.7 times as steep": _pitched(0.7),
    "half the ballast": _ballasted(0.5),
    "dives three times as deep": _deeper,
}
"""Manoeuvres by what they are called; each is flown as long as the record."""


def advice(stages: Sequence[SearchedStage]) -> tuple[Advice, ...]:
    """Effect of each manoeuvre on the intervals.

    Args:
        stages: stages of the fit.
    """
    told: dict[str, dict[str, float]] = {}
    for stage in stages:
        changes = dict(MANOEUVRES)
        if any(p.name == "angle_offset" for p in stage.numbers):
            changes["half as much roll again"] = _rolled
        for name, change in changes.items():
            shares = told.setdefault(name, {})
            shares |= _shares(stage, change)
    return tuple(Advice(name, shares) for name, shares in told.items())


def _shares(stage: SearchedStage, change: Change) -> dict[str, float]:
    solution = stage.solution
    flown = stage.model.changed(change)
    more = information(flown, stage.measured, solution.noise, solution.x)
    size = len(solution.x)
    after = np.linalg.inv(solution.information + more + np.eye(size))
    shares = np.sqrt(np.diag(after) / np.diag(solution.covariance))
    return {p.name: float(s) for p, s in zip(stage.numbers, shares, strict=True)}


def best_of(advices: Sequence[Advice], name: str) -> tuple[str, float, float] | None:
    """The manoeuvre that narrows a number most, its share, and that of the same again.

    Args:
        advices: advice on all manoeuvres.
        name: name of the number.
    """
    known = [(a.shares[name], a.manoeuvre) for a in advices if name in a.shares]
    if not known:
        return None
    share, manoeuvre = min(known)
    same = next(s for s, m in known if m == SAME)
    return manoeuvre, share, same
