"""Sensor errors, failing actuators and the judging funnel inside the closed loop."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from jaxglider import Specification, paper
from jaxglider.core.containers import as_float
from jaxglider.signals import Command
from jaxglider.vehicle.actuators import NEVER, Actuator, Failure
from jaxglider.vehicle.sensors import Sensor, realise_errors

KEY = jr.key(3)
STUCK, WEAK, SHARE = 4.0, 6.0, 0.4


def troubled(bias=0.0, noise=0.0, stuck=NEVER, weak=NEVER, width=1.0):
    """The paper's case with sensors, actuators that fail, and a funnel to judge by."""
    loop = paper.make_loop("switching", duration=20.0)
    plain = loop.scenario.actuators
    actuators = Command(
        Actuator(plain.buoyancy_mass.limit, failure=Failure(weak, SHARE)),
        Actuator(plain.mass_position.limit, failure=Failure(stuck_from=stuck)),
        plain.mass_angle,
    )
    funnel = paper.funnel("switching")
    judge = eqx.tree_at(
        lambda f: f.transformation.depth.lower, funnel, jnp.asarray(width)
    )
    scenario = dataclasses.replace(
        loop.scenario,
        actuators=actuators,
        sensors={"heading": Sensor(bias), "depth": Sensor(0.0, noise)},
        specification=Specification(judge),
    )
    return dataclasses.replace(loop, scenario=scenario)


@pytest.fixture(scope="module")
def fly(simulate_jit):
    def run(**trouble):
        loop = troubled(**trouble)
        scenario = loop.scenario
        return simulate_jit(loop, scenario.sea(KEY), scenario.noise(KEY))

    return run


@pytest.fixture(scope="module")
def calm(fly):
    return fly()


def test_absent_trouble_is_the_plain_loop(calm, simulate_jit):
    loop = paper.make_loop("switching", duration=20.0)
    plain = simulate_jit(loop, loop.scenario.sea(KEY))
    for a, b in zip(jax.tree.leaves(calm), jax.tree.leaves(plain), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


def test_without_sensors_and_specification_a_tick_has_no_place_for_them():
    loop = paper.make_loop("switching", duration=1.0)
    bare = dataclasses.replace(loop.scenario, specification=None)
    loop = dataclasses.replace(loop, scenario=bare)
    inputs = loop.inputs(loop.scenario.sea(KEY), loop.scenario.noise(KEY))
    plan = inputs.plan
    assert inputs.noise_start is plan.noise_end is plan.judging is None


def test_a_controller_sees_the_measured_state(fly, simulate_jit):
    biased = fly(bias=0.1)
    shifted = paper.make_loop("switching", duration=20.0)
    shifted = eqx.tree_at(
        lambda at: at.scenario.initial_state.heading, shifted, as_float(0.1)
    )
    seen = simulate_jit(shifted, shifted.scenario.sea(KEY))
    first = lambda run: jax.tree.map(lambda x: float(x[0]), run.ticks.wanted)
    for a, b in zip(
        jax.tree.leaves(first(biased)), jax.tree.leaves(first(seen)), strict=True
    ):
        assert a == pytest.approx(b, rel=1e-12)
    assert float(biased.ticks.state.heading[0]) == 0.0


def test_a_bias_moves_the_observer_nowhere_and_noise_does(fly, calm):
    # A constant error of the heading leaves all velocities as they are.
    estimate = lambda run: np.asarray(run.ticks.estimate.yaw)
    np.testing.assert_allclose(
        estimate(fly(bias=1e-9)), estimate(calm), atol=1e-9, rtol=0
    )
    assert np.abs(estimate(fly(noise=0.1)) - estimate(calm)).max() > 1e-6


def test_errors_are_judged_by_the_true_state(fly):
    run = fly(bias=0.1, noise=0.05)
    ticks = run.ticks
    for channel in ("depth", "pitch", "heading"):
        true = np.asarray(getattr(ticks.state, channel))
        aim = np.asarray(getattr(ticks.reference, channel))
        error = np.asarray(getattr(ticks.error, channel))
        np.testing.assert_allclose(error, true - aim, atol=1e-12)
    rms = np.sqrt(np.mean(np.asarray(ticks.error.depth) ** 2))
    assert float(run.metrics.channels.depth.rms_error) == pytest.approx(rms)


def test_noise_is_white_with_its_deviation_and_each_sensor_has_its_own():
    times = 0.05 * jnp.arange(20001)
    sensors = {"pitch": Sensor(0.3, 0.2), "depth": Sensor(0.0, 0.2)}
    errors = {k: np.asarray(v) for k, v in realise_errors(sensors, KEY, times).items()}
    # Standard error of the mean 0.0014, of the deviation 0.001, of a correlation 0.007.
    assert errors["pitch"].mean() == pytest.approx(0.3, abs=0.006)
    assert errors["pitch"].std() == pytest.approx(0.2, abs=0.004)
    x = errors["pitch"] - 0.3
    assert abs(np.corrcoef(x[1:], x[:-1])[0, 1]) < 0.03
    assert abs(np.corrcoef(x, errors["depth"])[0, 1]) < 0.03
    alone = realise_errors({"depth": sensors["depth"]}, KEY, times)
    np.testing.assert_array_equal(alone["depth"], errors["depth"])


def test_a_stuck_actuator_stays_and_a_weak_one_reaches_its_share(fly, calm):
    run = fly(stuck=STUCK, weak=WEAK)
    time = np.asarray(run.ticks.time)
    held = np.asarray(run.ticks.applied.mass_position)
    np.testing.assert_array_equal(
        held[time < STUCK], np.asarray(calm.ticks.applied.mass_position)[time < STUCK]
    )
    after = held[time >= STUCK]
    assert np.ptp(after) == 0.0
    assert after[0] == held[time < STUCK][-1] != 0.0
    wanted = np.clip(np.asarray(run.ticks.wanted.buoyancy_mass), -0.4, 0.4)
    share = np.where(time >= WEAK, SHARE, 1.0)
    np.testing.assert_allclose(
        run.ticks.applied.buoyancy_mass, share * wanted, rtol=1e-12
    )


def test_one_funnel_judges_whoever_steers_with_another(fly, calm):
    run = fly(width=0.01)
    # The controller flies as before, and is found outside.
    np.testing.assert_array_equal(run.ticks.error.depth, calm.ticks.error.depth)
    error = np.asarray(run.ticks.error.depth)
    bound = paper.funnel("switching").performance.depth
    edge = 0.01 * np.asarray(jax.vmap(bound)(run.ticks.clock).value)
    np.testing.assert_allclose(run.ticks.limits.depth.lower, -edge, rtol=1e-12)
    outside = np.mean((error > 100 * edge) | (error < -edge))
    depth = run.metrics.channels.depth
    assert 0.0 < float(depth.time_outside_funnel) == pytest.approx(outside)
    peak = np.max(np.maximum(error / (100 * edge), -error / edge))
    assert float(depth.funnel_peak) == pytest.approx(peak)
    assert peak > 1.0
    assert float(calm.metrics.channels.depth.time_outside_funnel) == 0.0


def test_what_is_no_sensor_or_failure_is_refused():
    scenario = paper.make_scenario(duration=1.0)
    with pytest.raises(ValueError, match="received 'sonar'; choose from north"):
        dataclasses.replace(scenario, sensors={"sonar": Sensor()})
    with pytest.raises(ValueError, match=r"Sensor\.noise must be zero or positive"):
        Sensor(0.0, -1.0)
    with pytest.raises(ValueError, match=r"effectiveness must be in \[0, 1\]"):
        Failure(0.0, 1.1)
