"""Test vectors: what goes into the autopilot tick by tick, and what comes out of it.

`fly` closes the loop around the simulated glider, `replay` feeds measurements that are
given. `broken` spoils measurements the way sensors, clocks and links do.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxglider.core.containers import Scalar, Series
from jaxglider.export.plant import (
    PlantState,
    drift,
    through_the_water,
    truth_of,
)
from jaxglider.export.sensing import ideal, sampled, unseen
from jaxglider.navigation.sensing.readings import InstrumentSamples
from jaxglider.onboard.guard import BITS
from jaxglider.onboard.of_loop import Pilot
from jaxglider.onboard.samples import Samples
from jaxglider.onboard.sensed import SensedAutopilot
from jaxglider.signals import BodyAxes, Command, GliderState, map_fields, zeros
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.origin import Origin


class TickLog(eqx.Module):
    """One tick of an autopilot; a run is this with a leading time axis.

    Attributes:
        time: reading of the clock [s].
        measured: measurement, or samples.
        planned: plan of the reference.
        command: command of the autopilot [kg, m, rad].
        status: status word of the autopilot.
        segment: sum of the numbers of segment and waypoint: it changes where a funnel
            restarts.
    """

    time: Scalar
    measured: Any
    planned: Any
    command: Command[Scalar]
    status: jax.Array
    segment: jax.Array


def _tick(pilot: Pilot, state: Any, time: Scalar, measured: Any) -> tuple[Any, TickLog]:
    planned = pilot.plan(state, time)
    after, command, status = pilot.step(state, time, measured, planned)
    whole = [
        x
        for x in jax.tree.leaves((planned, after.reference))
        if jnp.issubdtype(x.dtype, jnp.integer)
    ]
    segment = jnp.asarray(sum(whole, 0), jnp.int32)
    return after, TickLog(
        time=time,
        measured=measured,
        planned=planned,
        command=command,
        status=status,
        segment=segment,
    )


def through_the_map(state: Any, origin: Origin) -> Any:
    """A measurement as it comes back from its true position, as C code rounds it."""
    if not origin.moved:
        return state
    if isinstance(state, Samples):
        if state.fix is None:
            return state
        fix = through_the_map(state.fix, origin)
        return eqx.tree_at(lambda s: s.fix, state, fix)
    # A barrier: a compiler must not take off at once what it has just put on.
    true = lax.optimization_barrier(
        (state.north + origin.north, state.east + origin.east)
    )
    return eqx.tree_at(
        lambda s: (s.north, s.east),
        state,
        (true[0] - origin.north, true[1] - origin.east),
    )


@jax.jit
def replay(pilot: Pilot, times: Series, measured: Any) -> TickLog:
    """Ticks of an autopilot under recorded measurements.

    Args:
        pilot: the autopilot, from its initial state on.
        times: readings of its clock [s].
        measured: measurement, or samples, at each of them.
    """

    def tick(state: Any, inputs: Any) -> tuple[Any, TickLog]:
        return _tick(pilot, state, *inputs)

    return lax.scan(tick, pilot.init(), (times, measured))[1]


@jax.jit
def fly(
    pilot: Pilot,
    loop: ClosedLoop,
    forces: BodyAxes[Series],
    drawn: InstrumentSamples | None = None,
) -> tuple[TickLog, GliderState]:
    """The autopilot steering the glider of a closed loop.

    Args:
        pilot: the autopilot.
        loop: closed loop with the glider.
        forces: external force of each tick, constant within it [N, N m].
        drawn: chance of the sensors at each tick; None for sensors without errors. An
            autopilot that is told its state has none.

    Returns:
        The ticks, and the glider's state at the end of each.
    """
    scenario = loop.scenario
    truth = truth_of(loop)
    clock = scenario.clock.dt
    start = PlantState(
        scenario.initial_state, zeros(Command, clock), jnp.zeros_like(clock)
    )
    times = jnp.arange(forces.surge.shape[0], dtype=clock.dtype) * clock

    def told(seen: Any, time: Scalar, afloat: PlantState, row: Any) -> tuple[Any, Any]:
        if not isinstance(pilot, SensedAutopilot):
            return through_the_water(truth, afloat), None
        if row is None:
            return ideal(pilot, time, afloat), None
        now = sampled(loop, seen, time, afloat, row)
        return now.samples, now

    def tick(carry: Any, inputs: Any) -> tuple[Any, Any]:
        (state, afloat, seen), (time, force, row) = carry, inputs
        measured, seen = told(seen, time, afloat, row)
        measured = through_the_map(measured, scenario.origin)
        after, log = _tick(pilot, state, time, measured)
        following = drift(loop, truth, afloat, log.command, force)
        return (after, following, seen), (log, following.state)

    first = None
    if isinstance(pilot, SensedAutopilot) and drawn is not None:
        first = unseen(loop, pilot)
    begun = (pilot.init(), start, first)
    return lax.scan(tick, begun, (times, forces, drawn))[1]


def sea(loop: ClosedLoop, ticks: int, hold: int = 1) -> BodyAxes[Series]:
    """The force on each tick, that of the mission held constant over some ticks.

    Args:
        loop: closed loop with the disturbance, drawn with seed 0.
        ticks: number of ticks.
        hold: ticks over which the force is constant.
    """
    clock = dataclasses.replace(loop.scenario.clock, ticks=ticks)
    path = dataclasses.replace(loop.scenario, clock=clock).sea(jax.random.key(0))
    return map_fields(lambda f: jnp.repeat(f[:-1:hold], hold)[:ticks], path)


def window(log: TickLog, ticks: int) -> slice:
    """Ticks around the first restart of the funnel, or the first ones.

    All before the mission's end, where it lasts that long: after it nothing is steered.

    Args:
        log: a run.
        ticks: number of ticks.
    """
    finished = np.asarray(log.status) & BITS["finished"] > 0
    under_way = int(np.argmax(finished)) if finished.any() else len(finished)
    last = min(max(under_way, ticks), len(finished)) - ticks
    restarts = np.flatnonzero(np.diff(np.asarray(log.segment)))
    first = int(restarts[0]) - ticks // 2 if len(restarts) else 0
    first = max(min(first, last), 0)
    return slice(first, first + ticks)


def broken(times: np.ndarray, measured: Any, seed: int) -> tuple[np.ndarray, Any]:
    """Measurements and clock spoiled in bursts, good again in between.

    Args:
        times: readings of the clock [s].
        measured: measurements or samples, with a leading time axis.
        seed: seed of the faults.
    """
    draw = np.random.default_rng(seed)
    count = len(times)
    faulty = np.repeat(draw.random(-(-count // 20)) < 0.4, 20)[:count]
    wild = np.array([np.nan, np.inf, -np.inf, 1e30, -1e30, 1e300, 1e-320, 0.0, 5e3])

    def spoil(x: Any) -> np.ndarray:
        hit = faulty & (draw.random(count) < 0.3)
        if np.asarray(x).dtype == bool:
            return np.asarray(x) ^ hit
        return np.where(hit, draw.choice(wild, count), np.asarray(x))

    clock = np.array(times, dtype=float)
    step = np.median(np.diff(clock)) if count > 1 else 1.0
    kinds = draw.integers(0, 12, count)
    for n in np.flatnonzero(faulty):
        clock[n] = _spoiled_clock(clock, int(n), int(kinds[n]), float(step), draw)
    # Not `map_fields`: a state refuses NaN where it is built.
    return clock, jax.tree.map(spoil, measured)


def _spoiled_clock(
    clock: np.ndarray, n: int, kind: int, step: float, draw: np.random.Generator
) -> float:
    """One reading: missing, absurd, repeated, reversed, set forward, or right."""
    before = clock[n - 1] if n else clock[n]
    faults: Sequence[float] = (
        np.nan,
        np.inf,
        1e30,
        -1.0,
        before,
        before - 10.0 * draw.random(),
        clock[n] + 100.0 * draw.random(),
        clock[n] + 3 * step,
    )
    return float(faults[kind]) if kind < len(faults) else float(clock[n])
