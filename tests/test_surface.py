"""The surface holds a glider up to it and no farther, and a run above it is told."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import AttitudeSchedule, Clock, Schedule, paper
from jaxglider.environment.surface import DIAMETER, surface_force
from jaxglider.signals import BodyAxes, Command, GliderState, zeros
from jaxglider.simulation.checks.start import above_the_surface
from jaxglider.simulation.motion import integrate
from jaxglider.simulation.tick import TickInput, TickPlan
from jaxglider.vehicle.plants import PLANTS

GRAVITY = 9.81


@jax.jit
def float_up(scenario, command, start):
    """300 s without waves or controller, tick by tick."""
    zero = zeros(BodyAxes, start.surge)
    calm = TickPlan(0.0 * start.surge, zero, None, None, None, None)

    def tick(state, _):
        after = integrate(scenario, state, command, TickInput(calm, zero, None))
        return after, after

    return jax.lax.scan(tick, start, None, length=6000)[1]


def floating(mass, light):
    """Height of the hull's top at which its lost buoyancy is what it has too much."""
    roots = np.roots([-2.0, 3.0, 0.0, -light / mass])
    (s,) = (r.real for r in roots if abs(r.imag) < 1e-9 and 0.0 < r.real < 1.0)
    return s * DIAMETER


@pytest.mark.parametrize("plant", list(PLANTS))
def test_a_light_glider_ends_floating_at_rest(plant):
    scenario = paper.make_scenario("switching", plant)
    command = Command(jnp.asarray(-0.1), jnp.asarray(0.0), jnp.asarray(0.0))
    path = float_up(scenario, command, GliderState.at_rest(depth=2.0))
    height = floating(float(scenario.plant.displaced_mass()), 0.1)
    assert 0.004 < height < 0.006
    np.testing.assert_allclose(path.depth[-200:], -height, atol=2e-5)
    np.testing.assert_allclose(path.heave[-200:], 0.0, atol=2e-4)
    assert path.depth.min() > -DIAMETER


@pytest.mark.parametrize("plant", list(PLANTS))
def test_the_force_is_that_of_a_potential_and_waves_only_take_energy(plant):
    """Power of the force, and the rate of the potential from its closed form."""
    own = paper.make_scenario("switching", plant).plant
    mass, gravity = float(own.displaced_mass()), float(own.parameters.gravity)
    draw = np.random.default_rng(5)
    lost = []
    for _ in range(30):
        depth = draw.uniform(-1.5 * DIAMETER, 0.2 * DIAMETER)
        state = GliderState.at_rest(
            depth=depth,
            **dict(zip(("roll", "pitch", "heading"), draw.normal(size=3), strict=True)),
            **dict(zip(("surge", "sway", "heave"), draw.normal(size=3), strict=True)),
        )
        force = surface_force(own, state)
        assert [float(x) for x in (force.roll, force.pitch, force.yaw)] == [0.0] * 3
        pairs = zip(force.fields()[:3], state.velocity().fields()[:3], strict=True)
        power = sum(float(f * v) for f, v in pairs)
        rolled = np.sin(state.roll) * state.sway + np.cos(state.roll) * state.heave
        sinking = np.cos(state.pitch) * rolled - np.sin(state.pitch) * state.surge
        s = np.clip(-depth / DIAMETER, 0.0, 1.0)
        # P = m g D (s³ − s⁴/2): its slope with height is m g s² (3 − 2 s).
        h = 1e-6
        stored = [mass * gravity * DIAMETER * (x**3 - x**4 / 2) for x in (s + h, s - h)]
        slope = (stored[0] - stored[1]) / (2.0 * h * DIAMETER)
        rate = -float(sinking) * (slope if s < 1.0 else mass * gravity)
        gone = power + rate
        wave = mass * np.sqrt(gravity / DIAMETER) * 4.0 * s * (1.0 - s) * sinking**2
        np.testing.assert_allclose(gone, -wave, atol=1e-6 * mass * gravity)
        lost.append(gone < -1e-3)
    assert any(lost)


def test_energy_never_grows_while_a_hull_bobs():
    """Neutral and at rest above the sea: it falls, and comes to rest lower."""
    scenario = paper.make_scenario("switching", "printed")
    still = Command(jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(0.0))
    path = float_up(scenario, still, GliderState.at_rest(depth=-0.2))
    mass = float(scenario.plant.displaced_mass())
    gravity = float(scenario.plant.parameters.gravity)
    s = np.clip(-np.asarray(path.depth) / DIAMETER, 0.0, 1.0)
    inertia = float(scenario.plant.parameters.heave_mass)
    energy = mass * gravity * DIAMETER * (s**3 - s**4 / 2)
    energy += 0.5 * inertia * np.asarray(path.heave) ** 2
    assert np.diff(energy).max() < 1e-6 * energy[0]
    assert energy[-1] < energy[0]


def test_nothing_acts_on_what_is_under_water():
    plant = paper.make_scenario().plant
    for depth, speed in itertools.product((0.0, 1e-9, 3.0), (-1.0, 1.0)):
        state = GliderState.at_rest(depth=depth, surge=speed, pitch=0.3, roll=0.1)
        assert not any(float(x) for x in jax.tree.leaves(surface_force(plant, state)))
    slope = jax.grad(
        lambda z: surface_force(plant, GliderState.at_rest(depth=z, heave=1.0)).heave
    )(0.0)
    assert np.isfinite(slope)


def yo(rates, initial=0.0, start=0.0, duration=60.0):
    count = len(rates)
    schedule = Schedule(
        20.0 * np.arange(count), [-0.6] * count, [0.0] * count, rates, initial
    )
    scenario = paper.make_scenario("switching")
    return dataclasses.replace(
        scenario,
        clock=Clock.lasting(duration),
        reference=AttitudeSchedule(schedule),
        initial_state=GliderState.at_rest(depth=start),
    )


def test_what_is_wanted_above_the_surface_is_said():
    assert above_the_surface(yo([0.1])) == []
    assert above_the_surface(yo([0.1, -0.1, 0.1])) == []
    assert above_the_surface(yo([0.1, -0.1, -0.1], duration=40.0)) == []
    (text,) = above_the_surface(yo([-0.1]))
    assert "up to 6 m at 60 s" in text
    (text,) = above_the_surface(yo([0.1, -0.25, 0.5]))
    assert "up to 3 m at 40 s" in text
    (text,) = above_the_surface(yo([0.1], initial=-1.5))
    assert "up to 1.5 m at 0 s" in text
    (text,) = above_the_surface(yo([0.1], start=-2.0))
    assert "starts 2 m above the surface" in text
    path = dataclasses.replace(
        paper.reference("waypoints"), vertical=yo([-0.1]).reference.schedule
    )
    (text,) = above_the_surface(dataclasses.replace(yo([0.1]), reference=path))
    assert "up to 6 m at 60 s" in text


def test_validate_says_so(call, tmp_path):
    lines = (
        "clock = {duration_s = 20.0}",
        '[controller]\ntype = "smc"',
        "[reference.schedule]",
        "start_s = [0.0]",
        "gliding_angle_deg = [35.0]",
        "heading_deg = [0.0]",
        "depth_rate_m_s = -0.1",
    )
    (tmp_path / "up.toml").write_text("\n".join(lines))
    code, _, said = call("validate", "up.toml")
    assert code == 0
    assert "warning: the wanted depth is above the surface, up to 2 m at 20 s" in said
