"""`validate` finds what can be flown and is hardly meant, and says why."""

import math
import tomllib

import jax
import numpy as np
import pytest
import tomli_w

from jaxglider import paper
from jaxglider.core.toml import ConfigError
from jaxglider.files.flight.missions import mission_names, mission_path
from jaxglider.files.mission import TEMPLATE, build_mission, load_mission
from jaxglider.simulation.checks.causes import start_through_water
from jaxglider.simulation.checks.sense import sense_warnings
from jaxglider.simulation.checks.task import Ability
from jaxglider.trim.straight_glide import glide_limits

SCHEDULE = {
    "start_s": [0.0],
    "gliding_angle_deg": [-30.0],
    "heading_deg": [0.0],
    "depth_rate_m_s": [0.05],
}


def tables(**more):
    return {
        "vehicle": {"data": "slocum", "plant": "rigid-body"},
        "controller": {"type": "smc"},
        "clock": {"duration_s": 200.0},
        "reference": {"schedule": SCHEDULE},
    } | more


def asking(**schedule):
    return {"reference": {"schedule": SCHEDULE | schedule}}


MISTAKES = {
    "current in cm/s": (
        {"water": {"current": {"east_m_s": 20.0}}},
        "water.current reaches 20 m/s, more than any sea has",
    ),
    "start at rest in a current": (
        {"water": {"current": {"north_m_s": 0.3}}},
        "the water meets it at 0.3 m/s, 180 deg off its nose",
    ),
    "angle of the mass in degrees": (
        {"actuators": {"mass_angle": {"limit_rad": 90.0}}},
        "actuators.mass_angle.limit_rad is 90, and no glider goes beyond 3.14 rad",
    ),
    "rate in cm/s": (
        {"actuators": {"mass_position": {"rate_limit_m_s": 0.5}}},
        "actuators.mass_position.rate_limit_m_s is 0.5, faster than any glider's",
    ),
    "ballast in g": (
        {"actuators": {"buoyancy_mass": {"limit_kg": 230.0}}},
        "actuators.buoyancy_mass.limit_kg is 230, and no glider goes beyond 4.2 kg",
    ),
    "sign of the gliding angle": (
        asking(gliding_angle_deg=[30.0]),
        "One of them has the wrong sign",
    ),
    "too flat a glide": (
        asking(gliding_angle_deg=[-5.0]),
        "glides at -5 deg, flatter than this glider can: its shallowest dive is 16",
    ),
    "too fast a dive": (
        asking(depth_rate_m_s=[2.0]),
        "asks for a depth rate of 2 m/s at -30 deg; with all its ballast this glider",
    ),
    "tick of a navigator": (
        {"clock": {"dt_s": 4.0, "duration_s": 200.0}},
        "the integration step of 4 s is too long for the glider, whose fastest motion",
    ),
    "below the bottom": (
        {"seabed": {"depth_m": 5.0}},
        "the wanted depth comes to 10 m at 200 s, below the bottom at 5 m",
    ),
    "mass in g": (
        {
            "vehicle": {
                "data": "slocum",
                "plant": "rigid-body",
                "parameters": {"surge_mass": 84e3},
            }
        },
        "vehicle.parameters.surge_mass is 8.4e+04; the gliders of the package have",
    ),
    "segment after the end": (
        asking(
            start_s=[0.0, 900.0],
            gliding_angle_deg=-30.0,
            heading_deg=0.0,
            depth_rate_m_s=0.05,
        ),
        "the run ends at 200 s: 1 of 2 segments, from 900 s on, are never flown",
    ),
    "force in g": (
        {"disturbance": [{"type": "constant", "force_N": [0.0, 20.0, 0.0]}]},
        "a disturbance of 20 N is more than the ballast weighs (2.26 N)",
    ),
    "density in kg/m^3": (
        {"water": {"stratification": {"density_gradient_1_m": 0.0625}}},
        "It is relative, not in kg/m^3 per metre",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_found_and_named(mistake):
    change, said = MISTAKES[mistake]
    found = sense_warnings(build_mission(tables(**change)).loop)
    assert any(said in text for text in found), found


@pytest.mark.parametrize("name", [*mission_names(), "template", "plain"])
def test_what_ships_makes_sense(name):
    if name in mission_names():
        loop = load_mission(mission_path(name)).loop
    else:
        data = tables() if name == "plain" else tomllib.loads(TEMPLATE())
        loop = build_mission(data).loop
    assert sense_warnings(loop) == []


def test_the_shallowest_glide_is_that_of_the_closed_form():
    scenario = paper.make_scenario("switching", "seawing")
    ability = Ability.of(scenario)
    dive, climb = jax.jit(glide_limits)(scenario.plant)
    assert ability.shallowest(True) == pytest.approx(abs(float(dive)), rel=1e-3)
    assert ability.shallowest(False) == pytest.approx(float(climb), rel=1e-3)
    # Weight and water alone: V² = m_b g / |F| at the glide's own angle of attack.
    limit = float(scenario.actuators.buoyancy_mass.limit)
    steep = math.radians(-60.0)
    p = scenario.plant.parameters
    lift_and_drag = float(p.drag) / abs(math.sin(steep))
    most = math.sqrt(limit * float(p.gravity) / lift_and_drag) * abs(math.sin(steep))
    assert 0.8 * most < ability.fastest(steep) <= 1.05 * most


def test_a_start_may_be_given_through_the_water():
    start = {"heading_deg": 50.0, "surge_through_water_m_s": 0.2}
    water = {"current": {"north_m_s": 0.1, "east_m_s": -0.3}}
    loop = build_mission(tables(water=water, initial_state=start)).loop
    np.testing.assert_allclose(start_through_water(loop), (0.2, 0.0, 0.0), atol=1e-12)
    # Over ground it is that and the current: by hand, north and east.
    state = loop.scenario.initial_state
    turn = math.radians(50.0)
    north = float(state.surge) * math.cos(turn) - float(state.sway) * math.sin(turn)
    east = float(state.surge) * math.sin(turn) + float(state.sway) * math.cos(turn)
    assert north == pytest.approx(0.2 * math.cos(turn) + 0.1)
    assert east == pytest.approx(0.2 * math.sin(turn) - 0.3)
    both = start | {"surge_m_s": 0.1}
    with pytest.raises(ConfigError, match="does not go with initial_state"):
        build_mission(tables(water=water, initial_state=both))


def test_limits_beyond_the_file_of_the_vehicle_are_remarked_on():
    """A file made by `init` has the limits and the plant of another glider."""
    data = tomllib.loads(TEMPLATE())
    assert build_mission(data).remarks == ()
    data["vehicle"]["data"] = "slocum"
    plant, ballast, position = build_mission(data).remarks
    assert plant.startswith('vehicle.plant is "printed"')
    assert "limit_kg is 0.4, beyond the 0.23 kg that the file of Slocum" in ballast
    assert "limit_m is 0.06, beyond the 0.036 m" in position


def test_strict_makes_errors_of_warnings(call, tmp_path):
    change, _ = MISTAKES["angle of the mass in degrees"]
    (tmp_path / "m.toml").write_text(tomli_w.dumps(tables(**change)))
    code, out, err = call("validate", "m.toml", "--strict")
    assert (code, out) == (2, "")
    first, *_, last = [line for line in err.splitlines() if "leaves out" not in line]
    assert first.startswith("jaxglider: error: actuators.mass_angle.limit_rad is 90, ")
    assert "m.toml: 2 errors, with --strict" in last
