"""Water takes energy from a glider whichever way it moves: ahead, astern, broadside."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import GliderState, load_vehicle, paper
from jaxglider.core.runge_kutta import RK4, runge_kutta_step
from jaxglider.signals import BodyAxes, Command, zeros

SEAWING = load_vehicle("seawing")
NAMES = [f.name for f in dataclasses.fields(BodyAxes)]


def directions(count):
    """Unit vectors all around, the axes among them."""
    vectors = np.random.default_rng(0).normal(size=(count, 3))
    vectors[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def water(plant, velocities):
    """Force and moment of the water, one row for each velocity."""
    force = jax.jit(jax.vmap(plant.water))(BodyAxes(*velocities.T))
    return np.stack(force.fields(), axis=1)


@pytest.mark.parametrize("name", paper.PLANTS)
def test_the_force_of_the_water_never_does_work_on_the_glider(name):
    rng = np.random.default_rng(1)
    velocities = rng.uniform(-0.3, 0.3, (500, 6))
    velocities[:, :3] = directions(500) * rng.uniform(0.01, 2.0, (500, 1))
    power = water(paper.PLANTS[name](SEAWING), velocities)[:, :3] * velocities[:, :3]
    scale = np.sum(np.abs(power), axis=1)
    assert np.all(np.sum(power, axis=1) <= 1e-12 * scale)
    ahead = velocities[:, 0] > 0.1
    assert np.all(np.sum(power, axis=1)[ahead] < 0.0)


@pytest.mark.parametrize("name", paper.PLANTS)
@pytest.mark.parametrize("surge", [0.5, -0.5])
def test_turning_is_damped_ahead_as_astern(name, surge):
    """K_p, K_q and K_r times V², as printed for a glider that moves ahead."""
    p = SEAWING.parameters
    damping = np.array([p.roll_damping, p.pitch_damping, p.yaw_damping])
    still = np.array([[surge, 0, 0, 0, 0, 0]])
    turning = np.concatenate([np.tile([surge, 0, 0], (3, 1)), 0.2 * np.eye(3)], axis=1)
    plant = paper.PLANTS[name](SEAWING)
    moment = (water(plant, turning) - water(plant, still))[:, 3:]
    wanted = 0.2 * surge**2 * np.diag(damping)
    np.testing.assert_allclose(moment, wanted, rtol=1e-9, atol=1e-9)


def test_the_damping_has_no_step_where_the_flow_comes_abeam():
    plant = paper.PLANTS["seawing"](SEAWING)
    for heave in (0.4, -0.4):
        rows = np.array([[s, 0.1, heave, 0.2, -0.1, 0.3] for s in (1e-9, 0.0, -1e-9)])
        found = water(plant, rows)
        np.testing.assert_allclose(found - found[1], 0.0, atol=1e-5)


@pytest.mark.parametrize("name", paper.PLANTS)
def test_a_glider_thrown_any_way_does_not_gain_speed(name):
    """Level and neutral, no input: kinetic energy is all there is to begin with."""
    plant = paper.PLANTS[name](SEAWING)
    count, ticks = 48, 1200
    starts = np.zeros((count, 6))
    starts[:, :3] = 0.5 * directions(count)
    starts[8:, 3:] = 0.05 * np.random.default_rng(2).normal(size=(count - 8, 3))
    # The one that went to 2.6e7 m/s within 28 s.
    starts[6] = [-0.1, 0, 0, 0, 0, 0]

    def fly(velocity):
        start = GliderState.at_rest(
            surge=velocity.surge,
            sway=velocity.sway,
            heave=velocity.heave,
            roll_rate=velocity.roll,
            pitch_rate=velocity.pitch,
            yaw_rate=velocity.yaw,
        )
        idle, calm = zeros(Command), zeros(BodyAxes)

        def step(state, _):
            rate = lambda at, node: plant.derivative(at, idle, calm)
            after = runge_kutta_step(RK4, rate, state, jnp.asarray(0.05))
            return after, jnp.stack(after.velocity().fields())

        return jax.lax.scan(step, start, None, length=ticks)[1]

    flown = np.asarray(jax.jit(jax.vmap(fly))(BodyAxes(*starts.T)))
    inertia = np.array(plant.model().parameters.inertia().fields())
    energy = 0.5 * np.sum(flown**2 * inertia, axis=2)
    first = 0.5 * np.sum(starts**2 * inertia, axis=1)
    # Thrown broadside, the full glider's roll moment of sideslip does some work on it.
    room = 1.25 if name == "seawing" else 1.0 + 1e-9
    assert np.all(energy <= room * first[:, None])
    assert np.max(np.abs(flown[6, :, 0])) < 0.1
    # Small angles know no force on a glider that moves broadside.
    moved = np.abs(starts[:, 0]) > 0.05
    assert np.all(energy[moved, -1] < 0.5 * first[moved])
