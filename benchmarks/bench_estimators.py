"""Estimators on a yo: how well each knows its depth rate, by what it reads.

`python benchmarks/bench_estimators.py` flies the Slocum "comet" by a script of ballast
and battery, up and down at 0.12 m/s with inflections of some 20 s, and lets every
estimator read its depth every 4 s with 5 cm of noise, and its attitude with that of a
Slocum's compass. It prints root mean square errors [cm/s], steady and in the first 40 s
after an inflection, over 16 seeds: of the exact design model, of one that is 20 %
wrong, and at another period of the sensors. The first dive and climb are left out: the
filter still learns in them. Run it in the folder above.
"""

import dataclasses
import functools
import math
import sys
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxglider.control.balance import angle_of_attack, trim_position
from jaxglider.core.runge_kutta import RK4, runge_kutta_step
from jaxglider.navigation.catalogue import ESTIMATORS, make_estimator
from jaxglider.navigation.estimator import AbstractEstimator, Moves
from jaxglider.navigation.sensing.instrument import Compass, Instrument
from jaxglider.navigation.sensing.readings import Instruments, Readings, Sensed
from jaxglider.signals import BodyAxes, Command, GliderState, depth_rate, zeros
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.full_plant import full_plant
from jaxglider.vehicle.published import load_vehicle
from tuning.cli.session.jax_setup import start_jax

DEGREE = math.pi / 180.0
TICK, STEPS, STEP = 4.0, 8, 0.5
HALF, HALVES = 320.0, 6
"""Length of a dive or a climb [s], and their number."""
PITCH, BALLAST = 21.5 * DEGREE, 0.2
PUMP, SHIFT = 0.0357, 0.0038
"""Rates of pump [kg/s] and battery [m/s]."""
AFTER = 40.0
SEEDS = 16


class Flight(NamedTuple):
    """A flight by script, tick by tick: states and actuators at its ends."""

    state: GliderState
    held: Command[Any]


def fly(dt: float = TICK, halves: int = HALVES) -> Flight:
    """The yo: dives and climbs of one length, the actuators at their rates."""
    data = load_vehicle("slocum-comet")
    plant = full_plant(data)
    model = plant.model()
    ticks = round(halves * HALF / dt)
    still, period = zeros(BodyAxes, jnp.zeros(())), jnp.asarray(STEP)

    def follow(held: Any, wanted: Any, rate: float) -> Any:
        return held + jnp.clip(wanted - held, -rate * STEP, rate * STEP)

    def step(carry: Any, number: Any) -> Any:
        state, held = carry
        down = jnp.where(jnp.floor(number * STEP / HALF) % 2 == 0, 1.0, -1.0)
        ballast = down * BALLAST
        pitch = -down * PITCH
        position = trim_position(model, pitch, ballast, angle_of_attack(model, pitch))
        held = Command(
            follow(held.buoyancy_mass, ballast, PUMP),
            follow(held.mass_position, position, SHIFT),
            held.mass_angle,
        )
        after = runge_kutta_step(
            RK4, lambda s, _: plant.derivative(s, held, still), state, period
        )
        return (after, held), (after, held)

    start = GliderState.at_rest(depth=5.0, pitch=-0.1, surge=0.1)
    numbers = jnp.arange(ticks * round(dt / STEP), dtype=float)
    first = (start, Command(0.0, 0.0, 0.0))
    _, all_of_it = jax.lax.scan(step, first, numbers)
    states, held = jax.tree.map(
        lambda x: x[round(dt / STEP) - 1 :: round(dt / STEP)], all_of_it
    )
    return Flight(
        *(
            jax.tree.map(lambda a, b: jnp.concatenate([jnp.asarray(a)[None], b]), x, y)
            for x, y in zip(first, (states, held), strict=True)
        )
    )


def sensors(period: float, noise: float = 0.05) -> Instruments:
    """Sensors of depth and attitude that read at one period."""
    return Instruments(
        Sensed(
            Instrument(period, noise=noise),
            Instrument(period, noise=0.2 * DEGREE),
            Instrument(period, noise=0.3 * DEGREE),
            Compass(period, noise=0.7 * DEGREE),
        )
    )


def read(
    instruments: Instruments, flight: Flight, key: jax.Array, dt: float
) -> Readings:
    """What the sensors show at the ends of all ticks of a flight."""
    times = dt * jnp.arange(flight.state.depth.shape[0])
    samples = instruments.realise(key, times)

    def tick(state: Any, row: Any) -> Any:
        truth, sample = row
        shown, after = instruments.step(state, truth, None, sample, jnp.asarray(dt))
        return after, shown

    first, rest = jax.tree.map(lambda x: x[0], flight.state), (flight.state, samples)
    rows = jax.tree.map(lambda x: x[1:], rest)
    return jax.lax.scan(tick, instruments.init(first), rows)[1]


def estimated(
    estimator: AbstractEstimator, flight: Flight, readings: Readings, dt: float
) -> GliderState:
    """The estimates at the ends of all ticks."""
    start, end = (
        jax.tree.map(lambda x, part=part: x[part], flight.held)
        for part in (slice(None, -1), slice(1, None))
    )

    def tick(state: Any, row: Any) -> Any:
        before, after, shown, truth = row
        state = estimator.step(
            state, shown, Moves(before, after), truth, jnp.asarray(dt)
        )
        return state, estimator.estimate(state)

    truth = jax.tree.map(lambda x: x[1:], flight.state)
    first = estimator.init(jax.tree.map(lambda x: x[0], flight.state))
    return jax.lax.scan(tick, first, (start, end, readings, truth))[1]


@functools.partial(jax.jit, static_argnames="dt")
def readings_of(
    instruments: Instruments, flight: Flight, keys: jax.Array, dt: float
) -> Readings:
    """What the sensors show, a row for each key."""
    return jax.vmap(lambda key: read(instruments, flight, key, dt))(keys)


@functools.partial(jax.jit, static_argnames="dt")
def estimates_of(
    estimator: AbstractEstimator, flight: Flight, readings: Readings, dt: float
) -> GliderState:
    """What an estimator makes of rows of readings."""
    return jax.vmap(lambda shown: estimated(estimator, flight, shown, dt))(readings)


def rate_errors(known: GliderState, flight: Flight) -> np.ndarray:
    """Errors of the depth rate at the ends of all ticks [m/s], a row for each key."""
    of_ticks = jax.vmap(depth_rate)
    true = of_ticks(jax.tree.map(lambda x: x[1:], flight.state))
    return np.asarray(jax.vmap(of_ticks)(known)) - np.asarray(true)


def steady_and_after(errors: np.ndarray, dt: float) -> tuple[float, float]:
    """Root mean squares [m/s], the first yo left out: the filter still learns."""
    time = dt * np.arange(1, errors.shape[1] + 1)
    after = time % HALF < AFTER
    kept = time > 2.0 * HALF
    steady, disturbed = (
        math.sqrt((errors[:, kept & part] ** 2).mean()) for part in (~after, after)
    )
    return steady, disturbed


def design_model(factor: float = 1.0) -> DesignModel:
    """The design model of the yo's glider, wrong by a factor."""
    exact = full_plant(load_vehicle("slocum-comet")).model()
    return dataclasses.replace(exact, parameters=exact.parameters.scaled(factor))


def main() -> int:
    start_jax(64)
    keys = jax.random.split(jax.random.key(0), SEEDS)
    flight = jax.jit(fly)()
    rows = [
        "| estimator | model | period | steady | 40 s after |",
        "|---|---|---|---:|---:|",
    ]
    for name in list(ESTIMATORS)[1:]:
        cases = [(1.0, 4.0), (0.8, 4.0), (1.2, 4.0), (1.0, 20.0)]
        for factor, period in cases if name != "linear" else [(1.0, 4.0), (1.0, 20.0)]:
            instruments = sensors(period)
            model = design_model(factor)
            estimator = make_estimator(name, model, instruments, STEPS)
            shown = readings_of(instruments, flight, keys, TICK)
            errors = rate_errors(estimates_of(estimator, flight, shown, TICK), flight)
            figures = (f"{100.0 * x:.2f}" for x in steady_and_after(errors, TICK))
            told = "exact" if factor == 1.0 else f"x {factor:g}"
            told = "none" if name == "linear" else told
            rows.append(
                f"| {name} | {told} | {period:g} s | " + " | ".join(figures) + " |"
            )
            sys.stderr.write(rows[-1] + "\n")
    sys.stdout.write("\n".join(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
