"""The autopilot on raw samples: as in simulation, in C, and through bad sensors."""

import dataclasses
import functools

import compiled_c
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_c import Onboard, columns

from jaxglider.export.autopilot import autopilot_source
from jaxglider.export.plant import PlantState, drift, truth_of
from jaxglider.export.sensing import ideal
from jaxglider.export.vectors import broken, fly, replay, sea
from jaxglider.files.flight.missions import mission_path
from jaxglider.files.mission import load_mission
from jaxglider.navigation.catalogue import make_estimator
from jaxglider.onboard.guard import BITS, status_names
from jaxglider.onboard.of_loop import autopilot
from jaxglider.onboard.samples import measured_or, with_no_traces
from jaxglider.signals import Command, zeros
from jaxglider.simulation.rollout import with_ticks

needs_compiler = pytest.mark.skipif(
    compiled_c.COMPILER is None, reason="no C compiler on this machine"
)
TICKS, PART = 500, 1000
FUZZED = 50_000
"""For each of two estimators: 100,000 in all, and 2000 for the third."""
PARTS = {"linear": range(50), "fixed-time": range(50), "model-aided": (17, 29)}
"""Parts of `PART` ticks of each; those of the third begin with next to no depth."""


@pytest.fixture(scope="module")
def mission():
    """A Slocum on its sensors, its filter in one step a tick: quick to compile."""
    return load_mission(mission_path("slocum-on-board")).loop


@pytest.fixture(scope="module")
def source(mission):
    """The C of an estimator's autopilot, written once."""
    return functools.cache(
        lambda name: autopilot_source(autopilot(with_estimator(mission, name)), "test")
    )


def with_estimator(loop, name):
    scenario = loop.scenario
    estimator = make_estimator(name, loop.controller.model, scenario.instruments, 2)
    return with_ticks(dataclasses.replace(loop, estimator=estimator), TICKS)


@pytest.fixture(scope="module")
def flown(mission, simulate_jit):
    """A flight in simulation, and the autopilot flying through the same chance."""
    loop = with_estimator(mission, "linear")
    noise = loop.scenario.noise(jax.random.key(0))
    ticks = simulate_jit(loop, loop.scenario.sea(jax.random.key(0)), noise).ticks
    drawn = jax.tree.map(lambda x: x[:-1], noise.instruments)
    log, _ = fly(autopilot(loop), loop, sea(loop, TICKS), drawn)
    return ticks, log


def test_with_sound_samples_it_flies_as_the_simulation_does(flown):
    ticks, log = flown
    for name, scale in (
        ("buoyancy_mass", 0.2),
        ("mass_position", 0.01),
        ("mass_angle", 0.5),
    ):
        np.testing.assert_allclose(
            getattr(log.command, name),
            getattr(ticks.applied, name),
            rtol=0,
            atol=1e-9 * scale,
        )
    assert set(np.asarray(ticks.phase)) >= {0, 1, 2, 3}
    assert np.ptp(np.asarray(log.command.mass_angle)) > 0.01
    words = set(np.asarray(log.status)[1:].tolist())
    assert words <= {0, BITS["saturated"]}
    # Depth comes every 4 s, and now and then a sample is lost.
    stamps = np.asarray(log.measured.sensed.depth.time)
    assert 0 < np.sum(np.diff(stamps) == 0.0) < 20


@pytest.fixture(scope="module")
def spoilt(flown):
    """Sound samples again and again, in bursts missing, absurd, stuck or jumping."""
    _, log = flown
    count = FUZZED // TICKS
    rows = jax.tree.map(
        lambda x: np.concatenate([np.asarray(x)] * count), (log.time, log.measured)
    )
    times, samples = np.arange(FUZZED) * 4.0, rows[1]
    late = times - np.asarray(rows[0])
    samples = eqx.tree_at(
        lambda s: [x.time for x in (*s.sensed.fields(), s.echo, s.fix)],
        samples,
        [x.time + late for x in (*samples.sensed.fields(), samples.echo, samples.fix)],
    )
    clock, bad = broken(times, samples, seed=3)
    draw = np.random.default_rng(4)
    depth = np.array(bad.sensed.depth.value)
    for start in range(300, FUZZED - 400, 900):
        stuck, jump = slice(start, start + 40), slice(start + 200, start + 240)
        depth[stuck] = depth[start]
        depth[jump] += 30.0 * draw.standard_normal()
    depth[PART * np.array(PARTS["model-aided"])] = 1e-320
    bad = eqx.tree_at(lambda s: s.sensed.depth.value, bad, depth)
    # In parts of one length, each from the start: one program does for all.
    return jax.tree.map(lambda x: np.asarray(x).reshape(-1, PART), (clock, bad))


@jax.jit
def side_by_side(pilot, times, samples):
    """Commands and status words of an autopilot on each part, all parts at once.

    Ticks of all parts, one behind the other: one program, and one loop of `PART` ticks.
    """
    each = jax.vmap(replay, in_axes=(None, 0, 0))(pilot, times, samples)
    return jax.tree.map(jnp.ravel, each)


@needs_compiler
@pytest.mark.parametrize("name", PARTS)
def test_compiled_code_follows_the_trace_through_bad_sensors(
    mission, spoilt, source, name, tmp_path
):
    loop = with_estimator(mission, name)
    pilot = autopilot(loop)
    given = jax.tree.map(lambda x: x[np.array(PARTS[name])], spoilt)
    expected = columns(side_by_side(pilot, *given))
    onboard = Onboard(tmp_path, source(name), "-O1")
    parts = [jax.tree.map(lambda x, n=n: x[n], given) for n in range(len(given[0]))]
    found = np.concatenate([onboard.replay(*part) for part in parts])
    actuators = loop.scenario.actuators
    limits = np.array([float(a.limit) for a in vars(actuators).values()])
    for commands in (found, expected):
        assert np.isfinite(commands).all()
        assert (np.abs(commands[:, :3]) <= limits * (1 + 1e-15)).all()
    words = {name for w in expected[:, 3] for name in status_names(int(w))}
    assert {"sample_refused", "measurement_lost", "clock_invalid"} <= words
    off = (np.abs(found - expected)[:, :3] / limits).max(axis=1)
    if name != "model-aided":
        np.testing.assert_array_equal(found[:, 3], expected[:, 3])
        assert off.max() < 1e-10
        return
    # Wild readings make much of a rounding, in JAX itself: there two runs with gains
    # 1e-15 apart tell how much, tick by tick.
    gains = jax.tree.map(lambda x: x * (1.0 + 1e-15), pilot.estimator)
    twin = eqx.tree_at(lambda p: p.estimator, pilot, gains)
    own = columns(side_by_side(twin, *given))
    own = (np.abs(own - expected)[:, :3] / limits).max(axis=1).reshape(-1, PART)
    allowed = 1e-10 + 1e3 * np.maximum.accumulate(own, axis=1).ravel()
    assert (off <= allowed).all()
    alike = allowed < 1e-5
    assert np.mean(alike) > 0.9
    np.testing.assert_array_equal(found[alike, 3], expected[alike, 3])


@pytest.fixture(scope="module")
def sail(mission):
    """Depth, pitch and belief in closed loop, the samples spoilt by a function."""
    loop = with_estimator(mission, "linear")
    pilot, dt = autopilot(loop), loop.scenario.clock.dt

    @jax.jit
    def run(kinds):
        truth, still = truth_of(loop), jax.tree.map(lambda f: f[0], sea(loop, 2))

        def tick(carry, given):
            (state, afloat), (time, kind) = carry, given
            sound = ideal(pilot, time, afloat)
            old = state.shown.depth
            depth = sound.sensed.depth
            value = jnp.where(kind == 1, jnp.nan, depth.value)
            value = jnp.where(kind == 2, old, value)
            value = jnp.where(kind == 3, value + 25.0, value)
            stamp = jnp.where(kind == 4, state.stamps.depth, depth.time)
            bad = eqx.tree_at(
                lambda s: (s.sensed.depth.value, s.sensed.depth.time),
                sound,
                (value, stamp),
            )
            after, command, word = pilot.step(state, time, bad, pilot.plan(state, time))
            following = drift(loop, truth, afloat, command, still)
            known = pilot.estimator.estimate(after.estimator)
            off = known.depth - afloat.state.depth
            return (after, following), (off, following.state.pitch, word)

        start = PlantState(
            loop.scenario.initial_state, zeros(Command, dt), jnp.zeros_like(dt)
        )
        times = dt * jnp.arange(TICKS)
        return jax.lax.scan(tick, (pilot.init(), start), (times, kinds))[1]

    return run


@pytest.mark.parametrize("kind", [1, 2, 3, 4], ids=["nan", "stuck", "jump", "silent"])
def test_the_estimate_comes_back_from_a_bad_sensor(sail, kind):
    kinds = np.zeros(TICKS, int)
    kinds[150:190] = kind
    off, pitch, words = map(np.asarray, sail(jnp.asarray(kinds)))
    said = [set(status_names(int(w))) for w in words[150:190]]
    lost = any("measurement_lost" in s for s in said)
    assert lost == (kind in (1, 4))
    assert ("sample_refused" in said[5]) == (kind == 1)
    assert np.abs(off[150:190]).max() > 0.2
    assert np.abs(off[260:]).max() < 1.0
    assert np.isfinite(pitch).all()


def test_next_to_nothing_is_zero():
    """XLA drops such numbers where it computes, C code does not."""
    trace, one = jnp.asarray(1e-320), jnp.ones(())
    assert np.asarray(trace) != 0.0
    assert np.asarray(with_no_traces(trace)) == 0.0
    assert np.asarray(measured_or(-trace, one, one)) == 0.0
    for kept in (1e-29, -2.0, np.inf, np.nan):
        np.testing.assert_array_equal(with_no_traces(kept * one), kept)


def test_what_no_glider_has_is_not_asked_for(mission, source):
    loop = with_estimator(mission, "linear")
    names = {f.name for f in source("linear").structures["measurement"].fields()}
    assert names == {
        "time",
        *(f"{k}{of}" for k in SENSORS for of in ("", "_time", "_valid")),
        *(f"position_{k}" for k in ("buoyancy_mass", "mass_position", "mass_angle")),
        *(f"fix_{k}" for k in ("north", "east", "time", "valid")),
    }
    told = autopilot_source(autopilot(loop, told_state=True), "test")
    names = {f.name for f in told.structures["measurement"].fields()}
    assert {"surge", "yaw_rate", "north"} <= names


SENSORS = ("depth", "roll", "pitch", "heading", "echo")


def test_an_estimator_that_no_glider_has_is_refused(mission):
    loop = with_estimator(mission, "perfect")
    with pytest.raises(ValueError, match="'perfect' knows the true state, and no"):
        autopilot(loop)
    autopilot(loop, told_state=True)
