"""Resolution of single precision: what it cannot tell apart is not flown.

A number of 24 bits has spacing |x| 2⁻²³ at most. Positions grow by centimetres a tick,
times by the tick, running sums by a share of themselves that shrinks with the ticks,
and the phase of a wave by its frequency times the time: each goes silently wrong where
the spacing is no longer small beside that. Double precision is far from all of these.
"""

from collections.abc import Iterator
from typing import Any

import jax
import numpy as np

from jaxglider.core.containers import concrete
from jaxglider.environment.disturbances import Sinusoid
from jaxglider.guidance.routes import route_of

SLOW = 0.2
"""Speed of a slow glider [m/s]."""
COARSE = 0.1
"""Largest spacing of positions, over the way of a slow glider in a tick."""
MOST_TICKS = 2**20
"""Ticks over which running sums keep their mean to a percent or so."""
PHASE = 0.01
"""Largest spacing of a phase [rad]."""

REMEDY = "Use --precision 64 (from Python, enable x64 in JAX)"


def check_resolution(scenario: Any) -> None:
    """Refuse a scenario in single precision that needs double.

    Args:
        scenario: the one to be flown; what is traced is not looked at.

    Raises:
        ValueError: names the key, the number and the remedy.
    """
    dt = concrete(scenario.clock.dt)
    if dt is None or dt.dtype != np.float32:
        return
    ticks = scenario.clock.ticks
    if ticks > MOST_TICKS:
        raise ValueError(
            f"clock.duration_s: {ticks} ticks are too many for single precision, whose "
            f"running sums and times are too coarse from {MOST_TICKS} on. {REMEDY}, "
            "shorten the run or lengthen clock.dt_s."
        )
    for name, value in _positions(scenario):
        farthest = float(np.max(np.abs(value), initial=0.0))
        spacing = float(np.spacing(np.float32(farthest)))
        if spacing > COARSE * SLOW * float(dt):
            raise ValueError(
                f"{name}: {farthest:.8g} m from where positions count from, single "
                f"precision resolves {spacing:.2g} m, too coarse for a tick of "
                f"{float(dt):g} s. {REMEDY}, or start nearer."
            )
    for name, frequency in _frequencies(scenario):
        phase = float(np.max(np.abs(frequency), initial=0.0)) * ticks * float(dt)
        if np.spacing(np.float32(phase)) > PHASE:
            raise ValueError(
                f"{name}: its phase of {phase:.3g} rad at the end of the run is too "
                f"coarse in single precision. {REMEDY}, or shorten the run."
            )


def _positions(scenario: Any) -> Iterator[tuple[str, np.ndarray]]:
    """North and east of start, leg and waypoints, by their keys in a mission."""
    reference, start = scenario.reference, scenario.initial_state
    places = {f"initial_state.{n}_m": getattr(start, n) for n in ("north", "east")}
    path = route_of(reference)
    if path is not None:
        for name in ("start_north", "start_east", "north", "east"):
            places[f"reference.waypoints.{name}_m"] = getattr(path, name)
    for name, value in places.items():
        seen = concrete(value)
        if seen is not None:
            yield name, seen


def _frequencies(scenario: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Angular frequencies of waves and tide [rad/s], by their keys in a mission."""
    terms = jax.tree.leaves(
        scenario.disturbance, is_leaf=lambda x: isinstance(x, Sinusoid)
    )
    for term in terms:
        if isinstance(term, Sinusoid):
            for frequency in term.frequency.fields():
                seen = concrete(frequency)
                if seen is not None:
                    yield "disturbance.period_s", seen
    current = None if scenario.water is None else scenario.water.current
    period = None if current is None else concrete(current.tide_period)
    if period is not None:
        yield "water.current.tide_period_s", 2.0 * np.pi / period
