"""Positions far from zero, and times far from the start, are flown right or refused."""

import contextlib
import dataclasses
import json
import math
import tomllib

import compiled_c
import jax
import jax.numpy as jnp
import netCDF4
import numpy as np
import pytest
from compiled_c import Onboard, columns

from jaxglider import Clock, WaypointPath, paper
from jaxglider.core.toml import ConfigError
from jaxglider.environment.disturbances import Sinusoid, axes
from jaxglider.environment.water import Current, Water
from jaxglider.export.autopilot import autopilot_source
from jaxglider.export.stablehlo import stablehlo
from jaxglider.export.vectors import replay, through_the_map
from jaxglider.files.mission import build_mission
from jaxglider.files.results import write_trajectories
from jaxglider.files.uncertainty import build_uncertainty
from jaxglider.onboard.guard import BITS, Guard
from jaxglider.onboard.of_loop import autopilot
from jaxglider.onboard.pipe import ChildProcess, _asking
from jaxglider.plotting.path import on_the_map
from jaxglider.signals import GliderState
from jaxglider.simulation.origin import NEAR, Origin
from jaxglider.uncertainty.quantities import uniform_uncertainty

UTM = (5432100.0, 458200.0)
MISSION = """
clock = {{duration_s = {duration}}}
[controller]
type = "fxtppc"
[reference]
type = "waypoints"
[reference.waypoints]
north_m = [{n} + 12.0, {n} + 30.0]
east_m = [{e} + 4.0, {e} - 9.0]
start_north_m = {n} + 0.0
start_east_m = {e} + 0.0
[initial_state]
north_m = {n} + 0.0
east_m = {e} + 3.0
"""


def mission(north=0.0, east=0.0, duration=200.0):
    """The same course anywhere; sums are taken here, in double precision."""
    text = MISSION.format(n=north, e=east, duration=duration)
    summed = "".join(
        line if " + " not in line and " - " not in line else _summed(line)
        for line in text.splitlines(keepends=True)
    )
    return build_mission(tomllib.loads(summed))


def _summed(line):
    key, _, value = line.partition(" = ")
    return f"{key} = {json.dumps(eval(value))}\n"


def single():
    return jax.enable_x64(False)


@pytest.mark.parametrize("precision", [single, contextlib.nullcontext])
@pytest.mark.parametrize("place", [UTM, (-7.1e6, 0.0), (0.0, 5e5), (1500.0, -2e3)])
def test_a_mission_is_the_same_program_and_numbers_wherever_it_is(precision, place):
    """So its verdict is the same, whatever command asks for it."""
    with precision():
        here, there = mission(), mission(*place)
    north, east = place
    # The glider starts three metres east of where the near mission counts from.
    assert there.loop.scenario.origin == Origin(north, east + 3.0)
    shifted = ("scenario.initial_state.east", "scenario.reference.east")
    shifted += ("scenario.reference.start_east",)
    leaves = jax.tree_util.tree_flatten_with_path(here.loop)[0]
    for (path, a), b in zip(leaves, jax.tree.leaves(there.loop), strict=True):
        name = ".".join(getattr(key, "name", "") for key in path)
        off = 3.0 if name in shifted else 0.0
        np.testing.assert_allclose(b, a - off, rtol=0.0, atol=1e-9, err_msg=name)
        assert a.dtype == b.dtype


def test_near_missions_count_from_zero_and_keep_their_digits():
    assert mission(NEAR - 40.0).loop.scenario.origin == Origin()
    assert Origin.at_start(0.0, -NEAR - 0.1) == Origin(0.0, -NEAR - 0.1)


@pytest.fixture(scope="module")
def run(simulate_jit):
    """A few ticks of the far mission."""
    loop = mission(*UTM, duration=0.5).loop
    return loop, jax.device_get(
        simulate_jit(loop, loop.scenario.sea(jax.random.key(0)))
    )


def test_results_are_on_the_map_in_double_precision(run, tmp_path):
    loop, flown = run
    coarse = jax.tree.map(
        lambda x: x.astype(np.float32) if x.dtype == np.float64 else x, flown
    )
    write_trajectories(tmp_path / "t.nc", {"a": coarse}, {}, loop.scenario.origin)
    with netCDF4.Dataset(tmp_path / "t.nc") as data:
        assert data["north"].dtype == data["east"].dtype == np.float64
        assert data["depth"].dtype == np.float32
        state = coarse.ticks.state
        np.testing.assert_allclose(data["north"][0] - UTM[0], state.north, atol=2e-9)
        np.testing.assert_allclose(
            data["east"][0] - UTM[1] - 3.0, state.east, atol=2e-9
        )


def test_figures_show_the_path_where_it_is(run):
    reference = run[0].scenario.reference
    drawn = on_the_map(reference, run[0].scenario.origin)
    assert np.asarray(drawn.north).tolist() == [UTM[0] + 12.0, UTM[0] + 30.0]
    assert np.asarray(drawn.east).tolist() == [UTM[1] + 4.0, UTM[1] - 9.0]
    assert (float(drawn.start_north), float(drawn.start_east)) == UTM


@pytest.mark.parametrize(
    "make",
    [
        lambda scenario: uniform_uncertainty(scenario, 0.0, 0.0, 2.0),
        lambda scenario: build_uncertainty(
            {
                "initial_state": {
                    "north_m": {"law": "uniform", "half_width": 2.0},
                    "east_m": {"law": "uniform", "half_width": 2.0},
                }
            },
            scenario,
        ),
    ],
)
def test_members_are_listed_on_the_map_and_flown_beside_the_origin(make):
    with single():
        uncertainty = make(mission(*UTM).loop.scenario)
        values = uncertainty.values(np.array([[0.25, 0.75]]))
        members = uncertainty.members(values, jax.random.split(jax.random.key(0), 1))
    assert values.tolist() == [[UTM[0] - 1.0, UTM[1] + 3.0 + 1.0]]
    flown = [float(members.values[f"initial_state.{n}"][0]) for n in ("north", "east")]
    assert flown == [-1.0, 1.0]


def test_a_program_in_the_loop_is_told_true_positions():
    class Peer(ChildProcess):
        def __init__(self):
            self.row = ()

        def command(self, *row):
            self.row = row
            return np.zeros(3)

    peer = Peer()
    row = [np.float32(x) for x in (0.5, 0.25, -0.125, 7.0)]
    assert _asking(peer, Origin(*UTM), np.float32)(*row).dtype == np.float32
    assert peer.row == (0.5, UTM[0] + 0.25, UTM[1] - 0.125, 7.0)


def test_stablehlo_takes_true_positions_too():
    texts = stablehlo(autopilot(mission(*UTM).loop))
    assert "5.432100e+06" in texts["glider_step.mlir"]
    assert (
        "5.432100e+06" not in stablehlo(autopilot(mission().loop))["glider_step.mlir"]
    )


@pytest.mark.skipif(compiled_c.COMPILER is None, reason="no C compiler here")
@pytest.mark.parametrize("flags", [(), ("-DGLIDER_FLOAT",)], ids=["double", "float"])
def test_the_exported_controller_steers_at_true_positions(flags, tmp_path):
    pilot = autopilot(mission(*UTM).loop)
    ticks = 200
    along = np.linspace(0.0, 9.0, ticks)
    rest = GliderState.at_rest(pitch=-0.7, surge=0.4, heading=0.32)
    rows = jax.tree.map(lambda x: np.full(ticks, x), rest)
    swing = 0.2 * np.sin(along)
    local = dataclasses.replace(rows, north=along, east=along / 3.0 - 3.0 + swing)
    local = through_the_map(local, pilot.origin)
    true = dataclasses.replace(
        local,
        north=np.asarray(local.north) + pilot.origin.north,
        east=np.asarray(local.east) + pilot.origin.east,
    )
    times = 0.05 * np.arange(ticks)
    source = autopilot_source(pilot, "test")
    assert "#define GLIDER_ORIGIN_NORTH 5432100.0" in source.header
    expected = columns(replay(pilot, times, local))
    flown = Onboard(tmp_path, source, *flags).replay(times, true)
    allowed = 5e-3 if flags else 1e-10
    np.testing.assert_allclose(flown[:, :3], expected[:, :3], atol=allowed)
    assert np.ptp(expected[:, 2]) > 0.1
    lost = BITS["measurement_lost"] | BITS["measurement_held"]
    assert not (flown[:, 3].astype(int) & lost).any()


@pytest.mark.parametrize(
    ("state", "message"),
    [
        ({"north": -2e6}, r"initial_state\.north must be within 1e\+06"),
        ({"heading": 1100.0}, r"initial_state\.heading must be within 1000"),
        ({"surge": 25.0}, r"initial_state\.surge must be within 20"),
    ],
)
def test_an_autopilot_that_would_believe_nothing_is_refused(state, message):
    loop = paper.make_loop("switching", "printed", "smc", duration=1.0)
    start = dataclasses.replace(loop.scenario.initial_state, **state)
    scenario = dataclasses.replace(loop.scenario, initial_state=start)
    with pytest.raises(ValueError, match=f"{message}.*would not steer"):
        autopilot(dataclasses.replace(loop, scenario=scenario))
    autopilot(
        dataclasses.replace(loop, scenario=scenario),
        Guard(position=1e7, angle=1e4, speed=50.0),
    )


def test_a_course_beyond_what_the_autopilot_believes_is_refused():
    loop = paper.make_loop("waypoints", "printed", "smc", duration=1.0)
    path = far(north=jnp.arange(5.0), east=jnp.full(5, -3e6))
    scenario = dataclasses.replace(loop.scenario, reference=path)
    with pytest.raises(ValueError, match=r"waypoints\.east must be within 1e\+06"):
        autopilot(dataclasses.replace(loop, scenario=scenario))


def changed(**changes):
    scenario = paper.make_scenario("waypoints", duration=changes.pop("duration", 1.0))
    return dataclasses.replace(scenario, **changes)


def far(**changes):
    path = paper.reference("waypoints")
    return dataclasses.replace(path, **changes)


@pytest.mark.parametrize(
    ("make", "key"),
    [
        (lambda: changed(duration=86400.0), "clock.duration_s: 1728000 ticks"),
        (
            lambda: changed(initial_state=GliderState.at_rest(east=458200.0)),
            "initial_state.east_m: 458200 m",
        ),
        (
            lambda: changed(reference=far(start_north=-5432100.0)),
            "reference.waypoints.start_north_m",
        ),
        (
            lambda: changed(reference=far(east=[2e4, 0.0, 1.0, 2.0, 3.0])),
            "reference.waypoints.east_m: 20000 m",
        ),
        (
            lambda: changed(
                disturbance=Sinusoid(axes(1.0), axes(50.0), axes()), duration=4e4
            ),
            "disturbance.period_s",
        ),
        (
            lambda: changed(water=Water(Current(tide_period=0.1)), duration=4e4),
            "water.current.tide_period_s",
        ),
    ],
)
def test_single_precision_is_refused_by_key_where_it_is_too_coarse(make, key):
    with single(), pytest.raises(ValueError, match=f"{key}.*--precision 64"):
        make()
    make()


def test_a_mission_too_far_for_single_precision_is_refused_as_a_file():
    with single(), pytest.raises(ConfigError, match=r"duration_s.*--precision 64"):
        mission(duration=1e5)
    assert mission(duration=1e5).loop.scenario.clock.ticks == 2_000_000


def test_what_single_precision_accepts_it_resolves():
    """Ticks at the longest run, and steps at the farthest waypoint, are told apart."""
    with single():
        times = np.asarray(Clock(2**20, 0.05).times(), np.float64)
        path = far(north=[0.0, 1.0, 2.0, 3.0, 16000.0])
        scenario = changed(reference=path)
    steps = np.diff(times[-1000:])
    np.testing.assert_allclose(steps, 0.05, rtol=0.1)
    assert isinstance(scenario.reference, WaypointPath)
    step = np.float32(16000.0 + 0.2 * 0.05) - np.float32(16000.0)
    assert math.isclose(step, 0.2 * 0.05, rel_tol=0.1)
