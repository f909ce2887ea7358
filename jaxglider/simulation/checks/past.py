"""A flight until a number of it makes no sense, on the host."""

import dataclasses
import functools

import jax
import numpy as np

from jaxglider.core.containers import as_float
from jaxglider.signals import Command, GliderState, map_fields
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.tick import TickRecord

LINEAR = ("surge", "sway", "heave")
"""Names of the velocities."""

LARGEST = {
    **dict.fromkeys(LINEAR, 30.0),
    **dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), 50.0),
    "depth": 12_000.0,
}
"""Moduli [m/s, rad/s, m] that no glider comes to: beyond them a number is absurd."""

WINDOW = 1000
"""Number of the last ticks that causes are looked for in."""


@dataclasses.dataclass(frozen=True)
class Culprit:
    """The first number that makes no sense.

    Attributes:
        tick: number of its record, or that of all records for the end of the run.
        time: time of it [s].
        name: name of the number, such as `surge` or `mass_angle wanted`.
        value: number itself.
    """

    tick: int
    time: float
    name: str
    value: float


@dataclasses.dataclass(frozen=True)
class Past:
    """Records of the ticks in which everything still made sense.

    Attributes:
        loop: closed loop that was flown.
        culprit: first number that made none.
        ticks: records before it, with one leading axis.
    """

    loop: ClosedLoop
    culprit: Culprit
    ticks: TickRecord

    @property
    def count(self) -> int:
        """Number of the records."""
        return len(self.time)

    @functools.cached_property
    def time(self) -> np.ndarray:
        """Times of the records [s]."""
        return np.asarray(self.ticks.time, np.float64)

    @functools.cached_property
    def through_water(self) -> np.ndarray:
        """Velocity through the water [m/s]; rows forward, to starboard, down."""
        return through_water(self.loop, self.ticks.state, self.time)

    def last_state(self) -> GliderState:
        """State in the last of the records, or at the start where there is none."""
        if not self.count:
            start = self.loop.scenario.initial_state
            return map_fields(lambda x: np.asarray(x, np.float64), start)
        return map_fields(lambda x: np.asarray(x, np.float64)[-1], self.ticks.state)

    def last_command(self) -> Command[np.ndarray]:
        """Command held in the last of the records, or none."""
        if not self.count:
            return Command(*(np.zeros(()),) * 3)
        return map_fields(lambda x: np.asarray(x, np.float64)[-1], self.ticks.applied)


def through_water(loop: ClosedLoop, state: GliderState, time: np.ndarray) -> np.ndarray:
    """Velocity through the water in body axes [m/s], one row each.

    Args:
        loop: closed loop whose water it is.
        state: states over ground.
        time: times of the states [s].
    """
    at, now = map_fields(as_float, state), as_float(time)
    relative, _ = jax.vmap(loop.scenario.through_water)(at, now)
    return np.stack([np.asarray(getattr(relative, x)) for x in LINEAR])


def first_nonsense(run: Trajectory, end: float) -> Culprit | None:
    """The first number of a run that is not finite, or that no glider comes to.

    Args:
        run: trajectory on the host, every tick recorded.
        end: time at which the run ends [s].
    """
    ticks = run.ticks
    active = np.asarray(ticks.active)
    found: list[tuple[int, str, float]] = []
    for name, values in _watched(ticks):
        bad = active & ~(np.abs(values) <= LARGEST.get(name, np.finfo(float).max))
        if bad.any():
            tick = int(np.argmax(bad))
            found.append((tick, name, float(values[tick])))
    if found:
        tick, name, value = min(found, key=lambda one: one[0])
        return Culprit(tick, float(ticks.time[tick]), name, value)
    if not bool(run.metrics.finite):
        # A mission that ended in that very tick has records of what was left of it.
        last = int(np.count_nonzero(active))
        time = end if last == len(active) else float(ticks.time[last])
        return Culprit(last, time, "state", float("nan"))
    return _at_the_end(run, int(active.sum()))


def _at_the_end(run: Trajectory, count: int) -> Culprit | None:
    """Nonsense of the last tick, after which a mission that is over has no record."""
    flight, end = run.metrics.flight, float(run.metrics.end_time)
    if flight is None or float(flight.made_good) <= LARGEST["surge"] * end:
        return None
    return Culprit(count, end, "way made good", float(flight.made_good))


def _watched(ticks: TickRecord) -> list[tuple[str, np.ndarray]]:
    """Names and values of the numbers that are looked at, causes before effects."""
    groups = (
        ("", ticks.state),
        (" wanted", ticks.wanted),
        (" applied", ticks.applied),
        (" error", ticks.error),
        (" estimate", ticks.estimate),
    )
    return [
        (name + what, np.asarray(values, np.float64))
        for what, group in groups
        for name, values in vars(group).items()
    ]


def before(run: Trajectory, tick: int) -> Trajectory:
    """The same trajectory without the records from a tick on.

    Args:
        run: trajectory on the host.
        tick: number of the first record that is left out.
    """
    ticks = jax.tree.map(lambda x: np.asarray(x)[:tick], run.ticks)
    return dataclasses.replace(run, ticks=ticks)
