"""Sensors on board against an event loop in NumPy, and their tables in files."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from jaxglider import paper
from jaxglider.core.toml import ConfigError, TomlTable
from jaxglider.files.flight.missions import mission_path
from jaxglider.files.flight.sensor_tables import read_sensors, sensor_sets
from jaxglider.files.gains import decode_gains, encode_gains
from jaxglider.files.mission import build_mission, load_mission
from jaxglider.navigation.catalogue import (
    ESTIMATORS,
    make_estimator,
    usual_instruments,
)
from jaxglider.navigation.estimator import innovation
from jaxglider.navigation.reckoning import Reckoning
from jaxglider.navigation.sensing.altimeter import Altimeter
from jaxglider.navigation.sensing.instrument import Compass, Instrument
from jaxglider.navigation.sensing.positioning import Fix, Positioning
from jaxglider.navigation.sensing.readings import Instruments, Reading, Sensed
from jaxglider.signals import GliderState
from tuning.problem.spec import ProblemSpec
from tuning.space.coordinates import tunable_paths

KEY = jr.key(5)
DT, TICKS = 0.5, 400


@pytest.fixture(scope="module")
def shown():
    """What the sensors of a glider whose depth is the time in seconds show."""

    @jax.jit
    def run(instruments, key):
        times = DT * jnp.arange(TICKS + 1)
        samples = instruments.realise(key, times)

        def tick(state, row):
            time, sample = row
            truth = GliderState.at_rest(depth=time, heading=0.02 * time)
            readings, after = instruments.step(
                state, truth, None, sample, jnp.asarray(DT)
            )
            return after, readings.sensed

        rows = jax.tree.map(lambda x: x[1:], (times, samples))
        start = instruments.init(GliderState.at_rest())
        return samples, jax.lax.scan(tick, start, rows)[1]

    return run


def suite(depth, heading=None):
    still = Instrument(1.0)
    return Instruments(Sensed(depth, still, still, heading or Compass(1.0)))


def events(period, latency, lost, errors):
    """Value, age and freshness at each tick, by a list of what is under way."""
    under_way, value, taken_at = [], 0.0, 0.0
    rows, next_sample, due_number = [], 0.0, 0
    for tick in range(TICKS + 1):
        time = tick * DT
        fresh = False
        if time >= next_sample - 1e-9:
            if not lost[due_number]:
                under_way.append((next_sample + latency, time, time + errors[tick]))
            next_sample, due_number = next_sample + period, due_number + 1
        while under_way and under_way[0][0] <= time + 1e-9:
            _, taken_at, value = under_way.pop(0)
            fresh = True
        rows.append((value, time - taken_at, fresh))
    return np.array(rows)[1:]


@pytest.mark.parametrize(
    ("period", "latency"), [(0.5, 0.0), (2.0, 0.0), (2.0, 1.5), (1.7, 0.8), (4.0, 0.2)]
)
def test_samples_come_are_held_and_are_late_as_in_an_event_loop(shown, period, latency):
    sensor = Instrument(period, latency, 0.3, 0.1, lost=0.2)
    samples, sensed = shown(suite(sensor), KEY)
    keys = jr.split(jr.split(jr.fold_in(KEY, 1_000_000), 6)[0], 3)
    lost = np.asarray(jr.uniform(keys[2], (TICKS + 1,))) < 0.2
    wanted = events(period, latency, lost, np.asarray(samples.sensed.depth.error))
    depth = sensed.depth
    np.testing.assert_allclose(depth.value, wanted[:, 0], atol=1e-9)
    np.testing.assert_allclose(depth.age, wanted[:, 1], atol=1e-9)
    np.testing.assert_array_equal(depth.fresh, wanted[:, 2].astype(bool))
    assert 0.1 < lost.mean() < 0.3


def test_noise_bias_and_quantum_are_those_asked_for(shown):
    sensor = Instrument(DT, noise=0.2, bias=0.5, bias_deviation=0.3, quantum=0.25)
    plain = dataclasses.replace(sensor, quantum=0.0)
    values = [np.asarray(shown(suite(s), KEY)[1].depth.value) for s in (sensor, plain)]
    assert np.all(np.abs(values[0] / 0.25 - np.round(values[0] / 0.25)) < 1e-9)
    assert np.abs(values[0] - values[1]).max() <= 0.125 + 1e-9
    error = values[1] - DT * np.arange(1, TICKS + 1)
    assert error.std() == pytest.approx(0.2, rel=0.15)
    biases = [
        np.asarray(plain.realise(jr.key(n), DT * jnp.arange(9.0)).error).mean()
        for n in range(200)
    ]
    # White noise of nine adds 0.067 to the 0.3.
    assert np.mean(biases) == pytest.approx(0.5, abs=0.09)
    assert np.std(biases) == pytest.approx(math.hypot(0.3, 0.067), rel=0.2)


def test_compass_errs_with_the_heading_alone(shown):
    compass = Compass(DT, once=0.05, twice=0.02)
    samples, sensed = shown(suite(Instrument(1.0), compass), KEY)
    true = 0.02 * DT * np.arange(1, TICKS + 1)
    a, b, c, d = np.asarray(samples.sensed.heading.swing)[0]
    wanted = a * np.sin(true) + b * np.cos(true)
    wanted += c * np.sin(2 * true) + d * np.cos(2 * true)
    np.testing.assert_allclose(
        np.asarray(sensed.heading.value) - true, wanted, atol=1e-12
    )
    assert 0.01 < np.abs(wanted).max() < 0.3


def test_rounding_has_the_slope_of_what_is_rounded():
    sensor = Instrument(1.0, quantum=0.1)
    sample = jax.tree.map(lambda x: x[3], sensor.realise(KEY, jnp.arange(9.0)))
    assert jax.grad(sensor.reading)(jnp.asarray(1.23), sample) == 1.0
    assert float(sensor.reading(jnp.asarray(1.23), sample)) == pytest.approx(1.2)


def test_altimeter_believes_three_good_echoes_within_its_cone_and_range():
    altimeter = Altimeter(1.0, lean=-0.4)
    sample = jax.tree.map(lambda x: x[2], altimeter.realise(KEY, jnp.arange(9.0)))

    def heights(rows):
        state, told = altimeter.init(GliderState.at_rest()), []
        for height, pitch, depth in rows:
            truth = GliderState.at_rest(pitch=pitch, depth=depth)
            value, state = altimeter.step(state, truth, jnp.asarray(height), sample)
            told.append(float(value))
        return told

    dive = -0.42, 10.0
    seen = heights([(9.0, *dive), (30.0, *dive), (7.0, *dive), (6.0, *dive)])
    assert seen == [math.inf, math.inf, 9.0, 7.0]
    for spoilt in [(9.0, 0.4, 10.0), (120.0, *dive), (1.0, *dive), (9.0, -0.42, 1.0)]:
        assert (
            heights([(9.0, *dive)] * 2 + [spoilt] + [(9.0, *dive)] * 2)[-1] == math.inf
        )


def test_fixes_come_at_the_surface_after_a_while():
    receiver = Positioning(first_fix=20.0, period=5.0, noise=0.0)
    state, fresh, exact = receiver.init(GliderState.at_rest()), [], jnp.zeros(())
    for tick in range(60):
        truth = GliderState.at_rest(depth=0.1 if tick != 40 else 2.0, north=7.0)
        fix, state = receiver.step(state, truth, (exact, exact), jnp.asarray(1.0))
        fresh.append(bool(fix.fresh))
        assert float(fix.north) == 7.0
    assert [n for n, x in enumerate(fresh, 1) if x] == [20, 25, 30, 35, 40]


def test_a_reading_that_is_no_number_or_jumps_is_not_believed_unless_it_lasts():
    def of(value, missed=0.0, fresh=True):
        reading = Reading(jnp.asarray(value), jnp.asarray(fresh), jnp.asarray(0.0))
        limit, count = jnp.asarray(2.0), jnp.asarray(missed)
        return innovation(reading, reading.value - 1.0, limit, count)

    assert float(of(2.5).value) == 1.5
    assert bool(of(2.5).believed)
    assert not bool(of(math.nan, 9.0).believed)
    assert float(of(math.nan).value) == 0.0
    assert not bool(of(50.0).believed)
    assert float(of(50.0).missed) == 1.0
    assert bool(of(50.0, 5.0).lost)
    assert float(of(50.0, 5.0).value) == 49.0
    assert not bool(of(1.5, fresh=False).believed)


def test_sets_come_with_the_package_and_a_mission_overrides_them():
    assert sensor_sets() == ["seaexplorer", "seaglider", "slocum"]
    vehicle = {"set": "seaexplorer", "depth": {"noise_m": 0.2}}
    plain = read_sensors(TomlTable({}, "sensors"), vehicle)
    assert float(plain.sensed.depth.noise) == 0.2
    assert float(plain.sensed.depth.period) == 20.0
    own = {"depth": {"noise_m": 0.1}, "heading": {"once_deg": 3.0}, "altimeter": "none"}
    mine = read_sensors(TomlTable({"set": "slocum", **own}, "sensors"), vehicle)
    assert float(mine.sensed.depth.noise) == 0.1
    assert float(mine.sensed.depth.quantum) == 0.01
    assert float(mine.sensed.heading.once) == pytest.approx(math.radians(3.0))
    assert mine.altimeter is None
    assert mine.positioning is not None
    assert read_sensors(None, vehicle) is None


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"set": "argo"}, "sensors.set must be one of seaexplorer, seaglider, slocum"),
        ({"depth": {"noize_m": 1.0}}, "unknown key sensors.depth.noize_m"),
        ({"sonar": {}}, "unknown key sensors.sonar"),
        ({"depth": {"period_s": 0.0}}, "period must be positive"),
        ({"depth": {"latency_s": 4.0}}, "latency must be shorter than the period of 4"),
        ({"pitch": "none"}, "sensors.pitch must be a table: no glider flies without"),
        ({"gps": {"noise_m": -1.0}}, "noise must be zero or positive"),
    ],
)
def test_bad_tables_are_refused_with_their_key(table, said):
    with pytest.raises(ConfigError, match=said):
        read_sensors(TomlTable(table, "sensors"), {})


def test_a_mission_has_sensors_and_an_estimator_only_if_it_says_so():
    shallow = load_mission(mission_path("slocum-shallow"))
    assert shallow.loop.scenario.instruments is shallow.loop.estimator is None
    assert shallow.loop.init().known is None
    mission = load_mission(mission_path("slocum-on-board"))
    assert type(mission.loop.estimator) is ESTIMATORS["model-aided"]
    assert mission.loop.estimator.steps == 8
    assert mission.loop.scenario.instruments.altimeter is not None
    with pytest.raises(ConfigError, match="estimator needs a table sensors"):
        build_mission({"estimator": {"type": "linear"}})
    with pytest.raises(ConfigError, match=r"estimator.type must be one of perfect"):
        build_mission({"sensors": {}, "estimator": {"type": "kalman"}})
    with pytest.raises(ConfigError, match=r"unknown key estimator\.bandwith"):
        build_mission({"sensors": {}, "estimator": {"type": "linear", "bandwith": {}}})
    with pytest.raises(ValueError, match="needs an estimator; received none"):
        dataclasses.replace(mission.loop, estimator=None).init()


@pytest.mark.parametrize("name", ESTIMATORS)
def test_gains_of_an_estimator_survive_a_file(name):
    loop = build_mission({"sensors": {}}).loop
    model = loop.controller.model
    estimator = make_estimator(name, model, usual_instruments())
    estimator = jax.tree.map(lambda x: x, estimator)
    tables = encode_gains(loop.controller, loop.observer, None, estimator)
    again = decode_gains(tables, "switching", model).estimator
    assert type(again) is type(estimator)
    for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(estimator), strict=True):
        assert float(a) == pytest.approx(float(b), rel=1e-12)


def test_law_and_estimator_are_tuned_together_by_default():
    loop = load_mission(mission_path("slocum-on-board")).loop
    # Its law has no disturbance observer with numbers of its own.
    assert ProblemSpec.of_loop(loop).paths == ("controller", "estimator")
    own = build_mission({"sensors": {}}).loop
    assert ProblemSpec.of_loop(own).paths == ("controller", "observer", "estimator")
    free = [p for p in tunable_paths(loop) if p.startswith("estimator")]
    assert {"estimator.mass_walk", "estimator.noise.depth"} <= set(free)
    assert not any("model" in path or "gate" in path for path in free)
    told = load_mission(mission_path("slocum-shallow")).loop
    assert "estimator" not in ProblemSpec.of_loop(told).paths


@pytest.mark.parametrize(
    ("estimated", "shown", "dived"),
    [(5.0, 5.0, True), (5.0, -0.5, False), (0.2, 40.0, False)],
    ids=["both", "an estimator gone astray", "a sensor that jumps"],
)
def test_a_dive_is_one_where_sensor_and_estimator_say_so(estimated, shown, dived):
    """Two minutes down, up again, and a fix 12 m off: a current of 0.1 m/s."""
    plant = paper.make_scenario("switching", "rigid-body").plant
    reckoning = Reckoning(plant.parameters)
    number = lambda x: jnp.asarray(float(x))
    at = lambda z: GliderState.at_rest(depth=z)
    belief = reckoning.init(at(number(0.0)))
    no_fix, fix = (Fix(jnp.asarray(x == 1), number(12.0), number(0.0)) for x in (0, 1))
    step = jax.jit(lambda b, z, s, f: reckoning.step(b, at(z), s, f, number(4.0)))
    for _ in range(29):
        belief = step(belief, number(estimated), number(shown), no_fix)
    belief = step(belief, number(0.0), number(0.0), no_fix)
    belief = step(belief, number(0.0), number(0.0), fix)
    north, east = belief.current
    np.testing.assert_allclose([north, east], [0.1 * dived, 0.0], atol=1e-12)
