"""Currents and density, against frames that drift and hand-made numbers."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import rotation_matrix

from jaxglider import Current, GliderState, Stratification, Water, load_vehicle, paper
from jaxglider.control import FxTPPC
from jaxglider.core.rotations import attitude, ned_to_body
from jaxglider.core.runge_kutta import RK4, runge_kutta_step
from jaxglider.environment.water import derivative_in_water
from jaxglider.files.mission import build_mission
from jaxglider.signals import BodyAxes, Command, zeros

PLANTS = {name: make(load_vehicle("seawing")) for name, make in paper.PLANTS.items()}
STATE = GliderState(5.0, -3.0, 40.0, 0.2, -0.6, 0.8, 0.4, 0.02, 0.03, 0.02, -0.01, 0.03)
COMMAND = Command(0.3, 0.01, 0.4)
BUSY = Current(0.1, -0.05, 0.002, 0.003, 0.04, -0.02, 600.0, 0.5)


def rotation(state):
    return np.asarray(rotation_matrix(state.roll, state.pitch, state.heading))


def body_current(current, state, time):
    north, east = current.velocity(state.depth, jnp.asarray(time))
    return rotation(state).T @ np.array([float(north), float(east), 0.0])


def relative(current, state, time):
    nu = np.array([float(x) for x in (state.surge, state.sway, state.heave)])
    return nu - body_current(current, state, time)


def test_ned_to_body_is_the_transposed_rotation():
    x = np.array([0.3, -1.2, 0.7])
    a = attitude(STATE.roll, STATE.pitch, STATE.heading)
    found = ned_to_body(a, *(jnp.asarray(v) for v in x))
    np.testing.assert_allclose(found, rotation(STATE).T @ x, rtol=1e-12)


@pytest.mark.parametrize("name", PLANTS)
def test_a_uniform_current_carries_the_glider_and_does_nothing_else(name):
    """Galileo: the same dive, seen from a frame that drifts with the water."""
    plant, current = PLANTS[name], Current(0.2, -0.1)
    carried = dataclasses.replace(
        STATE,
        **{
            axis: getattr(STATE, axis) + x
            for axis, x in zip(
                ("surge", "sway", "heave"),
                body_current(current, STATE, 0.0),
                strict=True,
            )
        },
    )

    @jax.jit
    def fly(state, water):
        def step(s, _):
            def rate(at, node):
                calm = zeros(BodyAxes, at.surge)
                return derivative_in_water(
                    plant, water, at, COMMAND, calm, jnp.asarray(0.0)
                )

            return runge_kutta_step(RK4, rate, s, jnp.asarray(0.01)), None

        return jax.lax.scan(step, state, None, length=1000)[0]

    still, drifting = fly(STATE, Water()), fly(carried, Water(current))
    for field in ("depth", "roll", "pitch", "heading", "roll_rate", "yaw_rate"):
        assert float(getattr(drifting, field)) == pytest.approx(
            float(getattr(still, field)), abs=1e-9
        )
    assert float(drifting.north - still.north) == pytest.approx(2.0, abs=1e-9)
    assert float(drifting.east - still.east) == pytest.approx(-1.0, abs=1e-9)
    np.testing.assert_allclose(
        relative(current, drifting, 0.0), relative(Current(), still, 0.0), atol=1e-9
    )


@pytest.mark.parametrize("name", PLANTS)
def test_shear_and_tide_change_the_velocity_through_the_water_as_the_plant_says(name):
    """d/dt (ν − Rᵀ v_c) along the path, by differences, is the plant's own rate."""
    plant, time, h = PLANTS[name], 130.0, 1e-4
    calm = zeros(BodyAxes)
    rate = derivative_in_water(
        plant, Water(BUSY), STATE, COMMAND, calm, jnp.asarray(time)
    )
    ahead, behind = (
        jax.tree.map(lambda x, k, s=s: x + s * h * k, STATE, rate) for s in (1, -1)
    )
    found = (relative(BUSY, ahead, time + h) - relative(BUSY, behind, time - h)) / (
        2 * h
    )
    through = relative(BUSY, STATE, time)
    moving = dataclasses.replace(
        STATE,
        **dict(zip(("surge", "sway", "heave"), map(jnp.asarray, through), strict=True)),
    )
    own = plant.derivative(moving, COMMAND, calm)
    np.testing.assert_allclose(
        found, [float(x) for x in (own.surge, own.sway, own.heave)], atol=1e-8
    )
    assert float(rate.yaw_rate) == pytest.approx(float(own.yaw_rate), rel=1e-9)
    over_ground = rotation(STATE) @ [float(STATE.surge), 0.02, 0.03]
    np.testing.assert_allclose(
        [float(x) for x in (rate.north, rate.east, rate.depth)], over_ground, rtol=1e-9
    )


def test_dense_water_lifts_and_a_soft_hull_sinks():
    sea = Stratification(65.28, 2e-5, 4e-6, 10.0)
    # 100 m below neutral depth: 65.28 kg (1.002 · 0.9996 − 1) more water displaced.
    expected = 65.28 * (1.0 - 1.002 * 0.9996)
    assert float(sea.excess_mass(jnp.asarray(110.0))) == pytest.approx(expected)
    assert expected < 0.0
    state = GliderState.at_rest(depth=110.0)
    for name, plant in PLANTS.items():
        rates = [
            derivative_in_water(
                plant, water, state, Command(0.1, 0.0, 0.0), zeros(BodyAxes), state.roll
            )
            for water in (Water(), Water(stratification=sea))
        ]
        share = float(rates[1].heave) / float(rates[0].heave)
        off = 0.03 if name == "seawing" else 1e-9  # it pitches as well
        assert share == pytest.approx((0.1 + expected) / 0.1, rel=off)


WATER = {
    "clock": {"duration_s": 20.0},
    "vehicle": {"plant": "seawing"},
    "water": {
        "current": {"east_m_s": 0.3, "tide_phase_deg": 90.0},
        "stratification": {"density_gradient_1_m": 2e-5},
    },
}


def test_a_mission_drifts_with_its_current(simulate_jit):
    mission = build_mission(WATER)
    water = mission.loop.scenario.water
    assert float(water.current.tide_phase) == pytest.approx(np.pi / 2)
    assert float(water.stratification.displaced_mass) == pytest.approx(65.28)
    still = build_mission({k: v for k, v in WATER.items() if k != "water"})
    assert still.loop.scenario.water is None
    sea = mission.loop.scenario.sea(jax.random.key(0))
    ends = [simulate_jit(m.loop, sea).ticks.state.east[-1] for m in (mission, still)]
    # At rest over ground, the water takes half a minute to carry it along.
    assert 1.0 < float(ends[0] - ends[1]) < 6.0


def test_a_law_flies_in_a_current_as_in_water_at_rest(simulate_jit):
    """Galileo: law, observer and actuators see no difference in a frame that drifts."""
    flow = {"surge_through_water_m_s": 0.1}
    drifting = {**WATER, "initial_state": flow}
    drifting["water"] = {"current": {"north_m_s": 0.07, "east_m_s": 0.1}}
    still = {**WATER, "initial_state": {"surge_m_s": 0.1}}
    still["water"] = {"current": {"north_m_s": 0.0, "east_m_s": 0.0}}
    loops = [build_mission(table).loop for table in (drifting, still)]
    assert isinstance(loops[0].controller, FxTPPC)
    sea = loops[0].scenario.sea(jax.random.key(0))
    there, here = (simulate_jit(loop, sea).ticks for loop in loops)
    np.testing.assert_allclose(
        there.state.east - here.state.east, 0.1 * there.time, atol=1e-9
    )
    for name in ("error", "applied", "estimate", "lumped", "surface"):
        for a, b in zip(
            *map(jax.tree.leaves, (getattr(there, name), getattr(here, name))),
            strict=True,
        ):
            np.testing.assert_allclose(a, b, atol=1e-7)


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"current": {"north": 1.0}}, "unknown key water.current.north"),
        ({"current": {"tide_period_s": 0.0}}, "tide_period must be positive"),
        ({"stratification": {"displaced_mass_kg": -1.0}}, "must be positive"),
        ({"waves": {}}, "unknown key water.waves"),
    ],
)
def test_odd_water_is_refused(table, text):
    with pytest.raises(ValueError, match=text):
        build_mission({**WATER, "water": table})
