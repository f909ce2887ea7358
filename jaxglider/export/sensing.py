"""Samples that the sensors of a simulated glider hand to its autopilot."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr

from jaxglider.core.containers import Scalar
from jaxglider.export.plant import PlantState
from jaxglider.navigation.sensing.readings import (
    InstrumentSamples,
    InstrumentState,
    Sensed,
)
from jaxglider.onboard.samples import FixSample, Sample, Samples
from jaxglider.onboard.sensed import SensedAutopilot
from jaxglider.signals import map_fields
from jaxglider.simulation.closed_loop import ClosedLoop

ANTENNA = 0.5
"""Depth above which ideal sensors have a position by satellite [m]; C has the same."""


class Seen(eqx.Module):
    """Sensors between two ticks, and what they gave last.

    Attributes:
        instruments: state of the sensors.
        samples: newest samples.
        first: flag, none has been taken yet.
    """

    instruments: InstrumentState
    samples: Samples
    first: jax.Array


def unseen(loop: ClosedLoop, pilot: SensedAutopilot) -> Seen:
    """Sensors before the first tick.

    Args:
        loop: closed loop with the sensors.
        pilot: autopilot that takes their samples.
    """
    assert loop.scenario.instruments is not None
    start = loop.scenario.initial_state.unturned()
    instruments = loop.scenario.instruments.init(start)
    return Seen(instruments, pilot.untold(), jnp.asarray(True))


def chance(loop: ClosedLoop, ticks: int) -> InstrumentSamples:
    """All chance of the sensors at the starts of some ticks, drawn with seed 0."""
    assert loop.scenario.instruments is not None
    times = jnp.arange(ticks) * loop.scenario.clock.dt
    return loop.scenario.instruments.realise(jr.key(0), times)


def ideal(pilot: SensedAutopilot, time: Scalar, afloat: PlantState) -> Samples:
    """Samples without errors, taken at once: what the tests in C have.

    Args:
        pilot: autopilot that takes them.
        time: reading of the clock [s].
        afloat: simulated glider.
    """
    yes, state = jnp.asarray(True), afloat.state
    sensed = map_fields(lambda x: Sample(x, time, yes), Sensed.of(state))
    fix = FixSample(state.north, state.east, time, state.depth < ANTENNA)
    none = pilot.untold()
    return Samples(sensed, afloat.held, none.echo, fix if pilot.receiver else None)


def sampled(
    loop: ClosedLoop,
    before: Seen,
    time: Scalar,
    afloat: PlantState,
    row: InstrumentSamples,
) -> Seen:
    """Samples of the mission's own sensors; the first ones, on deck, are right.

    Args:
        loop: closed loop with the sensors.
        before: sensors at the tick before.
        time: reading of the clock [s].
        afloat: simulated glider.
        row: chance of the sensors at this tick.
    """
    scenario, old, state = loop.scenario, before.samples, afloat.state
    assert scenario.instruments is not None
    height = scenario.altitude(state)
    readings, after = scenario.instruments.step(
        before.instruments, state, height, row, scenario.clock.dt
    )
    instruments = jax.tree.map(
        lambda a, b: jnp.where(before.first, a, b), before.instruments, after
    )
    sensed = map_fields(
        lambda reading, sample, true: Sample(
            jnp.where(before.first, true, reading.value),
            jnp.where(
                before.first,
                time,
                jnp.where(reading.fresh, time - reading.age, sample.time),
            ),
            jnp.asarray(True),
        ),
        *(readings.sensed, old.sensed, Sensed.of(state)),
    )
    echo, altimeter = old.echo, scenario.instruments.altimeter
    if echo is not None and altimeter is not None and height is not None:
        part = row.altimeter
        new = part.taken & ~before.first
        echo = _chosen(
            new,
            Sample(
                altimeter.reading(height, part), time, altimeter.sees(state, height)
            ),
            echo,
        )
    fix, told = old.fix, readings.fix
    if fix is not None and told is not None:
        here = FixSample(told.north, told.east, time, jnp.asarray(True))
        fix = _chosen(told.fresh & ~before.first, here, fix)
    samples = Samples(sensed, afloat.held, echo, fix)
    return Seen(instruments, samples, jnp.asarray(False))


def _chosen(flag: Any, yes: Any, no: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(flag, a, b), yes, no)
