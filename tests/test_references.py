"""Schedules and paths ask for what they should, when they should."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_physics import MatrixGlider, array

from jaxglider import AttitudeSchedule, LineOfSight, Schedule, WaypointPath, paper
from jaxglider.signals import BodyAxes, Command, GliderState, Measurement
from jaxglider.vehicle.published import load_vehicle

DT = 0.05
LOOKAHEAD, GAIN = 2.5, 0.01
GUIDANCE = LineOfSight(LOOKAHEAD, GAIN)
CHANGING = Schedule(
    start=[0.0, 10.0, 30.0],
    gliding_angle=[-0.7, -1.0, 0.6],
    heading=[0.5, 0.0, -0.5],
    depth_rate=[0.1, 0.2, -0.15],
    initial_depth=3.0,
)
LEVEL = Schedule([0.0], [-0.7], [0.0], [0.1])


def measure(state):
    zero = jnp.zeros_like(state.surge)
    return Measurement(
        state,
        state.attitude(),
        Command(zero, zero, zero),
        BodyAxes(*(zero,) * 6),
    )


@jax.jit
def step(reference, memory, state, time):
    planned = jax.tree.map(lambda x: x[0], reference.plan(time[None]))
    return reference.step(memory, planned, measure(state), jnp.asarray(DT))


def follow(reference, path, dt=DT):
    """References along given positions, one tick each."""
    memory = reference.init(GliderState.at_rest())
    results = []
    for n, (north, east) in enumerate(path):
        state = GliderState.at_rest(north=north, east=east, surge=0.4)
        asked, memory = step(reference, memory, state, jnp.asarray(n * dt))
        results.append((asked, memory))
    return results


def path_of(north, east, **options):
    return WaypointPath(
        north, east, GUIDANCE, LEVEL, options.pop("radius", 5.0), **options
    )


@pytest.fixture(scope="module")
def look_up():
    return jax.jit(jax.vmap(Schedule.at, in_axes=(None, 0)))


def test_schedule_looks_up_its_segment_with_the_start_belonging_to_it(look_up):
    times = [0.0, 9.999, 10.0, 29.999, 30.0, 1e4]
    found = look_up(CHANGING, jnp.array(times))
    numbers = [0, 0, 1, 1, 2, 2]
    assert found.number.tolist() == numbers
    for field in ("gliding_angle", "heading", "depth_rate"):
        values = np.asarray(getattr(CHANGING, field))[numbers]
        assert np.asarray(getattr(found, field)).tolist() == values.tolist()


def test_depth_is_the_integral_of_the_changing_rate(look_up):
    times = np.array([0.0, 5.0, 10.0, 20.0, 30.0, 50.0])
    found = look_up(CHANGING, jnp.asarray(times)).depth
    np.testing.assert_allclose(found, [3.0, 3.5, 4.0, 6.0, 8.0, 5.0], rtol=1e-14)
    # Nothing jumps where the rate changes.
    ends = np.array([10.0, 30.0])
    before = look_up(CHANGING, jnp.asarray(ends - 1e-9)).depth
    np.testing.assert_allclose(before, [4.0, 8.0], atol=1e-9)


def test_clock_restarts_with_each_segment(look_up):
    times = np.array([0.0, 9.5, 10.0, 12.0, 31.5, 130.0])
    found = look_up(CHANGING, jnp.asarray(times)).clock
    np.testing.assert_allclose(found, [0.0, 9.5, 0.0, 2.0, 1.5, 100.0])


def test_paper_s_schedule_is_its_table_and_its_clock_is_time_modulo_200(look_up):
    times = np.array([0, 199.95, 200, 399.95, 400, 599.95, 600, 799.95])
    found = look_up(paper.attitude_schedule(), jnp.asarray(times))
    angles = np.array([-45, -45, -60, -60, -45, -45, -60, -60])
    np.testing.assert_allclose(np.degrees(found.gliding_angle), angles)
    headings = np.array([30, 30, 0, 0, -30, -30, 18, 18])
    np.testing.assert_allclose(np.degrees(found.heading), headings, atol=1e-12)
    np.testing.assert_allclose(found.depth, 0.1 * times, rtol=1e-12)
    np.testing.assert_allclose(found.clock, times % 200, rtol=1e-12)


def test_single_segment_goes_on_for_ever(look_up):
    found = look_up(LEVEL, jnp.array([0.0, 1e3]))
    assert found.number.tolist() == [0, 0]
    np.testing.assert_allclose(found.depth, [0.0, 100.0])
    np.testing.assert_allclose(found.clock, [0.0, 1e3])


@pytest.mark.parametrize(
    ("surge", "heave", "attack"),
    [(0.4, 0.02, 0.05), (0.4, -0.02, -0.05), (0.0, 0.001, 0.05), (0.4, 1.0, 0.3)],
)
def test_wanted_pitch_is_gliding_angle_and_limited_angle_of_attack(
    surge, heave, attack
):
    reference = AttitudeSchedule(CHANGING)
    state = GliderState.at_rest(surge=surge, heave=heave)
    asked, _ = step(reference, None, state, jnp.asarray(12.0))
    np.testing.assert_allclose(asked.position.pitch, -1.0 + attack, rtol=1e-12)
    assert array(asked.rate).tolist() == [0.2, 0.0, 0.0]
    assert array(asked.acceleration).tolist() == [0.0, 0.0, 0.0]
    assert (int(asked.target), bool(asked.finished)) == (1, False)


def integral_rate(cross, integral):
    return LOOKAHEAD * cross / (LOOKAHEAD**2 + (cross + GAIN * integral) ** 2)


@pytest.mark.parametrize("azimuth", [0.3, 2.0, -2.5, math.pi])
@pytest.mark.parametrize("cross", [0.0, 4.0, -1.5])
def test_heading_is_the_azimuth_of_the_leg_less_the_line_of_sight_angle(azimuth, cross):
    along = np.array([np.cos(azimuth), np.sin(azimuth)])
    starboard = np.array([-np.sin(azimuth), np.cos(azimuth)])
    start = np.array([7.0, -3.0])
    end = start + 60 * along
    path = path_of([end[0]], [end[1]], start_north=start[0], start_east=start[1])
    position = start + 12 * along + cross * starboard
    integral = 30.0
    memory = dataclasses.replace(
        path.init(GliderState.at_rest()), integral=jnp.asarray(integral)
    )
    state = GliderState.at_rest(north=position[0], east=position[1])
    asked, after = step(path, memory, state, jnp.asarray(8.0))
    expected = azimuth - np.arctan((cross + GAIN * integral) / LOOKAHEAD)
    found = float(asked.position.heading) - expected
    np.testing.assert_allclose(math.remainder(found, 2 * np.pi), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        after.integral, integral + DT * integral_rate(cross, integral), rtol=1e-12
    )
    np.testing.assert_allclose(asked.position.depth, 0.8)


def test_wanted_heading_rate_is_the_change_of_the_wanted_heading():
    path = path_of([40.0], [25.0])
    glider = MatrixGlider(load_vehicle("seawing").parameters, rigid_body=True)
    attitude = {"roll": 0.2, "pitch": -0.6, "heading": 1.1}
    speed = {"surge": 0.5, "sway": 0.03, "heave": -0.02}
    velocity = glider.rotation(*attitude.values()) @ list(speed.values())
    position, integral = np.array([6.0, 1.0]), 12.0
    along = np.array([40.0, 25.0]) / np.hypot(40.0, 25.0)
    cross = along[0] * position[1] - along[1] * position[0]

    def ask(after):
        north, east = position + after * velocity[:2]
        memory = dataclasses.replace(
            path.init(GliderState.at_rest()),
            integral=jnp.asarray(integral + after * integral_rate(cross, integral)),
        )
        state = GliderState.at_rest(north=north, east=east, **attitude, **speed)
        return step(path, memory, state, jnp.asarray(1.0))[0]

    h = 1e-4
    slope = (ask(h).position.heading - ask(-h).position.heading) / (2 * h)
    found = ask(0.0).rate.heading
    assert abs(float(found)) > 0.01
    np.testing.assert_allclose(found, slope, rtol=1e-7)


def test_switch_resets_integral_and_clock_and_turns_to_the_next_leg():
    path = path_of([10.0, 10.0], [0.0, 30.0], radius=2.0)
    # Along the first leg off its line, into the circle, then on.
    places = [(2.0, 3.0), (6.0, 3.0), (8.5, 1.0), (9.0, 4.0)]
    results = follow(path, places)
    assert [int(asked.target) for asked, _ in results] == [0, 0, 1, 1]
    np.testing.assert_allclose(
        [float(asked.clock) for asked, _ in results], [0.0, DT, 0.0, DT], atol=1e-15
    )
    integrals = [0.0]
    for cross in (3.0, 3.0):
        integrals.append(integrals[-1] + DT * integral_rate(cross, integrals[-1]))
    # Starboard of the second leg, which runs east, is south.
    integrals.append(DT * integral_rate(10.0 - 8.5, 0.0))
    found = [float(memory.integral) for _, memory in results[:3]]
    np.testing.assert_allclose(found, integrals[1:], rtol=1e-12)
    expected = np.pi / 2 - np.arctan(1.5 / LOOKAHEAD)
    np.testing.assert_allclose(results[2][0].position.heading, expected, rtol=1e-12)
    # The vertical schedule runs on.
    np.testing.assert_allclose(results[3][0].position.depth, 0.1 * 3 * DT, rtol=1e-12)


@pytest.mark.parametrize(
    ("abeam", "off", "taken_from"),
    [(None, 4.0, None), (6.0, 4.0, 20.0), (6.0, 7.0, None), (6.0, 0.5, 18.06)],
)
def test_a_waypoint_missed_is_taken_abeam_if_asked_for(abeam, off, taken_from):
    """Past a waypoint at 20 m along a leg to the north-east, on a line beside it."""
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    ends = [20.0 * along, 20.0 * along + [30.0, 0.0]]
    path = path_of(*np.transpose(ends).tolist(), radius=2.0, abeam=abeam)
    distances = np.arange(0.25, 25.0, 0.5)
    results = follow(path, [d * along + off * across for d in distances])
    targets = np.array([int(asked.target) for asked, _ in results])
    wanted = distances >= (np.inf if taken_from is None else taken_from)
    np.testing.assert_array_equal(targets, wanted)


def test_the_last_waypoint_abeam_finishes_the_mission():
    path = path_of([20.0], [0.0], radius=2.0, abeam=6.0)
    results = follow(path, [(19.9, 4.0), (20.1, 4.0), (0.0, 0.0)])
    assert [bool(asked.finished) for asked, _ in results] == [False, True, True]


def test_last_waypoint_finishes_the_mission_for_good():
    path = path_of([10.0, 10.0], [0.0, 30.0], radius=2.0)
    places = [(9.0, 0.0), (10.0, 27.9), (10.0, 28.1), (0.0, 0.0)]
    results = follow(path, places)
    assert [bool(asked.finished) for asked, _ in results] == [False, False, True, True]
    assert [int(asked.target) for asked, _ in results] == [1, 1, 1, 1]


def test_single_waypoint_works():
    results = follow(path_of([20.0], [0.0]), [(0.0, 0.0), (14.0, 0.0), (15.0, 0.0)])
    assert [bool(asked.finished) for asked, _ in results] == [False, False, True]
    np.testing.assert_allclose(results[0][0].position.heading, 0.0)


def test_path_of_forty_waypoints_is_followed_leg_by_leg():
    rng = np.random.default_rng(41)
    count = 40
    north, east = np.cumsum(rng.uniform(8, 20, (2, count)), axis=1)
    path = path_of(north.tolist(), east.tolist(), radius=1.0)
    places = list(zip(north, east, strict=True))
    results = follow(path, [(0.0, 0.0), *places])
    targets = [int(asked.target) for asked, _ in results]
    assert targets == [*range(count), count - 1]
    assert [bool(asked.finished) for asked, _ in results] == [False] * count + [True]
    corners = np.array([(0.0, 0.0), *places])
    legs = np.diff(corners, axis=0)
    azimuths = np.arctan2(legs[:, 1], legs[:, 0])
    headings = [float(asked.position.heading) for asked, _ in results[:-1]]
    np.testing.assert_allclose(headings, azimuths, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"north": [], "east": []}, "at least 1 waypoint; received shapes"),
        ({"east": [5.0]}, r"one length.*\(2,\) and \(1,\)"),
        ({"north": [10.0, 10.0], "east": [5.0, 5.0]}, "waypoint 2 equals waypoint 1"),
        ({"start_north": 10.0, "start_east": 5.0}, "waypoint 1 equals the start"),
        ({"radius": 0.0}, "radius must be positive; received 0"),
        ({"radius": -5.0}, "radius must be positive; received -5"),
        ({"abeam": 0.0}, "abeam must be positive; received 0"),
        ({"north": [10.0, float("nan")]}, "north must be finite; received .*nan"),
        ({"start_east": float("inf")}, "start_east must be finite"),
    ],
)
def test_paths_that_cannot_be_followed_are_refused(changes, message):
    good = {
        "north": [10.0, 15.0],
        "east": [5.0, -10.0],
        "line_of_sight": GUIDANCE,
        "vertical": LEVEL,
        "radius": 5.0,
    }
    with pytest.raises(ValueError, match=message):
        WaypointPath(**{**good, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {key: [] for key in ("start", "gliding_angle", "heading", "depth_rate")},
            "at least 1",
        ),
        ({"heading": [0.1]}, "one length"),
        ({"start": [0.0, 0.0]}, "must begin at 0 and increase; received"),
        ({"start": [0.0, -5.0]}, "must begin at 0 and increase"),
        ({"start": [1.0, 5.0]}, "must begin at 0 and increase"),
        ({"depth_rate": [0.1, float("nan")]}, "depth_rate must be finite"),
        ({"start": [0.0, float("nan")]}, "start must be finite"),
        ({"initial_depth": float("nan")}, "initial_depth must be finite"),
    ],
)
def test_schedules_that_cannot_be_followed_are_refused(changes, message):
    good = {
        "start": [0.0, 10.0],
        "gliding_angle": [-0.7, -1.0],
        "heading": [0.0, 0.1],
        "depth_rate": [0.1, 0.1],
    }
    with pytest.raises(ValueError, match=message):
        Schedule(**{**good, **changes})


@pytest.mark.parametrize(
    ("gains", "message"),
    [
        ((0.0, 0.01), "lookahead must be positive"),
        ((-1.0, 0.01), "lookahead must be positive"),
        ((2.5, -0.01), "integral_gain must be zero or positive"),
        ((float("nan"), 0.01), "lookahead must be"),
    ],
)
def test_guidance_gains_out_of_range_are_refused(gains, message):
    with pytest.raises(ValueError, match=message):
        LineOfSight(*gains)
