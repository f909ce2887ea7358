"""Gains judged at other ticks, and from starts that differ by roundings alone.

A figure that changes with the tick says how the law was sampled, not how it steers. And
where starts 1e-10 m apart give different figures, roundings decide them: such a figure
is not reproducible, and the interval over roundings is what can be said.
"""

import dataclasses
from typing import Any

import equinox as eqx
import numpy as np

from jaxglider.signals import CHANNEL_UNITS, CHANNELS
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from tuning.evaluation.held_out import Judge

APART = 1e-10
"""Distance between starts that count as the same [m]."""
TICK_FACTORS = (0.5, 2.0)
"""Factors on the tick that figures are compared with."""
STARTS = (-2.0, -1.0, 1.0, 2.0)
"""Starts beside the nominal one, in that distance."""
SPREAD = 0.05
"""Share of a figure that may depend on roundings; from more on it is their work."""
TICK_SPREAD = 0.5
"""Share of a figure that may depend on the tick; from more on it is its work."""


@dataclasses.dataclass(frozen=True)
class Robustness:
    """Figures at other ticks and from other roundings.

    A figure is the rms error of a channel, of the nominal case or the mean of the
    held-out members that stayed finite; None where there is none.

    Attributes:
        ticks: figures at each tick [s] by its text, then `nominal` or `held_out`, then
            channel.
        roundings: smallest and largest figure over the starts, by `nominal` or
            `held_out`, then channel.
        not_reproducible: figures that roundings decide, as `held_out.heading`.
        tick_dependent: figures that half or twice the tick decides.
    """

    ticks: dict[str, dict[str, dict[str, float | None]]]
    roundings: dict[str, dict[str, list[float] | None]]
    not_reproducible: tuple[str, ...]
    tick_dependent: tuple[str, ...]

    def remarks(self) -> list[str]:
        """Sentences on what cannot be relied on; none where all can."""
        lines = []
        for name in self.not_reproducible:
            part, channel = name.split(".")
            low, high = self.roundings[part][channel] or (np.nan, np.nan)
            lines.append(
                f"not reproducible: {channel} rms error, {_WORDS[part]}, is "
                f"{low:.3g} to {high:.3g} {CHANNEL_UNITS[channel]} from starts "
                f"{APART:g} m apart."
            )
        for name in self.tick_dependent:
            part, channel = name.split(".")
            figures = ", ".join(
                f"{_cell(of[part][channel])} at {tick} s"
                for tick, of in self.ticks.items()
            )
            lines.append(
                f"depends on the tick: {channel} rms error, {_WORDS[part]}, is "
                f"{figures}."
            )
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, as they stand in tune.json."""
        return dataclasses.asdict(self)


_WORDS = {"nominal": "nominal case", "held_out": "mean of the held-out members"}


def judge_robustness(judge: Judge, loop: ClosedLoop) -> Robustness:
    """Judge a loop from other starts, and at half and twice its tick.

    Args:
        judge: judge of the problem, whose compiled runs serve for the starts.
        loop: closed loop with the gains.
    """
    here = _figures(judge.metrics(loop))
    starts = [here, *(_figures(judge.metrics(_moved(loop, x))) for x in STARTS)]
    dt = float(loop.scenario.clock.dt)
    ticks = {f"{dt:g}": here}
    for factor in TICK_FACTORS:
        ticks[f"{factor * dt:g}"] = _figures(judge.metrics(with_tick(loop, factor)))
    return robustness(starts, dict(sorted(ticks.items(), key=lambda x: float(x[0]))))


def robustness(
    starts: list[dict[str, dict[str, float | None]]],
    ticks: dict[str, dict[str, dict[str, float | None]]],
) -> Robustness:
    """Marks on figures from other starts and at other ticks.

    Args:
        starts: figures from each start.
        ticks: figures at each tick.
    """
    intervals = {
        part: {c: _range([of[part][c] for of in starts]) for c in CHANNELS}
        for part in _WORDS
    }
    sampled = {
        part: {c: _range([of[part][c] for of in ticks.values()]) for c in CHANNELS}
        for part in _WORDS
    }
    return Robustness(
        ticks,
        intervals,
        _wide(intervals, SPREAD),
        _wide(sampled, TICK_SPREAD),
    )


def with_tick(loop: ClosedLoop, factor: float) -> ClosedLoop:
    """The loop with another tick and the same horizon.

    Args:
        loop: closed loop.
        factor: factor on the tick.
    """
    clock = loop.scenario.clock
    ticks = max(round(clock.ticks / factor), 1)
    changed = dataclasses.replace(clock, ticks=ticks, dt=clock.dt * factor)
    scenario = dataclasses.replace(loop.scenario, clock=changed)
    return dataclasses.replace(loop, scenario=scenario)


def _moved(loop: ClosedLoop, steps: float) -> ClosedLoop:
    depth = loop.scenario.initial_state.depth + steps * APART
    return eqx.tree_at(lambda x: x.scenario.initial_state.depth, loop, depth)


def _figures(runs: tuple[Metrics, Metrics]) -> dict[str, dict[str, float | None]]:
    return {
        part: {c: _mean(metrics, c) for c in CHANNELS}
        for part, metrics in zip(_WORDS, runs, strict=True)
    }


def _mean(metrics: Metrics, channel: str) -> float | None:
    values = np.asarray(getattr(metrics.channels, channel).rms_error, float)
    finite = np.asarray(metrics.finite) & np.isfinite(values)
    return float(values[finite].mean()) if finite.any() else None


def _range(values: list[float | None]) -> list[float] | None:
    known = [x for x in values if x is not None]
    return [min(known), max(known)] if len(known) == len(values) else None


def _wide(
    ranges: dict[str, dict[str, list[float] | None]], share: float
) -> tuple[str, ...]:
    """Names of the figures whose range is more than a share of its lower end."""
    return tuple(
        f"{part}.{channel}"
        for part, of in ranges.items()
        for channel, ends in of.items()
        if ends is not None and ends[1] - ends[0] > share * ends[0]
    )


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
