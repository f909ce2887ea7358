"""Courses that can be flown, but were hardly meant so."""

import numpy as np
import pytest

from jaxglider.files.course_remarks import course_remarks

PATH = """
clock = {{duration_s = {duration}}}
initial_state = {{{start}}}
controller = {{type = "smc"}}
[reference]
type = "waypoints"
[reference.waypoints]
north_m = {north}
east_m = {east}
{more}
"""


def told(north, east, duration=800.0, more="", **start):
    """The tables of a mission."""
    places = {"north_m": north, "east_m": east, **(more or {})}
    return {
        "clock": {"duration_s": duration},
        "initial_state": start,
        "reference": {"type": "waypoints", "waypoints": places},
    }


GOTO = [([4123.456, 4125.1, 4124.0], [-7032.351, -7030.2, -7031.0]),
        ([-7032.351, -7031.5], [4123.456, 4124.25]),
        ([-3359.9], [15112.06]),
        ([5412.5], [801.25])]  # fmt: skip


@pytest.mark.parametrize(("north", "east"), GOTO)
def test_degrees_and_minutes_of_a_goto_file_are_remarked_on(north, east):
    (remark,) = course_remarks(told(north, east))
    assert "look like degrees and minutes" in remark
    assert f"({north[0]:g}"[:5] in remark


DECIMAL = [([41.3912], [-70.2057]), ([47.12345, 47.2001], [-88.54321, -88.6123])]


@pytest.mark.parametrize(("north", "east"), DECIMAL)
def test_decimal_degrees_are_remarked_on(north, east):
    (remark,) = course_remarks(told(north, east))
    assert "look like decimal degrees" in remark


def test_metres_to_the_centimetre_are_no_decimal_degrees():
    assert course_remarks(told([41.39, 60.5], [-70.2, 12.25])) == ()


def test_courses_in_metres_are_not_taken_for_degrees_and_minutes():
    rng = np.random.default_rng(0)
    wrong = 0
    for _ in range(500):
        # Legs from the glider on, in any direction, of 20 m to 2 km, to the centimetre.
        count, size = rng.integers(2, 8), 10.0 ** rng.uniform(1.3, 3.3)
        steps = size * rng.normal(size=(2, count))
        north, east = np.round(np.cumsum(steps, axis=1), 2).tolist()
        wrong += bool(course_remarks(told(north, east, 1e6)))
    assert wrong == 0
    assert course_remarks(told([1200.0, 1340.0], [100.0, 20.0], 1e5)) == ()
    assert course_remarks(told(12.5, 4.25)) == ()


def test_a_waypoint_out_of_reach_is_remarked_on():
    (remark,) = course_remarks(told([5432112.0], [458204.0], 200.0))
    assert "the first waypoint is 5.451e+06 m away, too far for 200 s" in remark
    away = {"north_m": 5432100.0, "east_m": 458200.0}
    leg = {"start_north_m": 5432100.0, "start_east_m": 458200.0}
    assert course_remarks(told([5432112.0], [458204.0], 200.0, leg, **away)) == ()


@pytest.mark.parametrize("start", [(3.0, 0.0), (0.0, -2.0), (-40.0, 25.0)])
def test_a_start_beside_the_first_leg_is_remarked_on(start):
    place = dict(zip(("north_m", "east_m"), start, strict=True))
    (remark,) = course_remarks(told([30.0, 60.0], [5.0, 5.0], **place))
    assert f"starts at ({start[0]:g}, {start[1]:g}) m" in remark
    assert f"start_north_m = {start[0]:g} and start_east_m = {start[1]:g}" in remark
    leg = dict(zip(("start_north_m", "start_east_m"), start, strict=True))
    assert course_remarks(told([30.0, 60.0], [5.0, 5.0], more=leg, **place)) == ()
    # Somebody has placed the leg, wherever that is.
    leg = {key: 0.0 for key in leg}
    assert course_remarks(told([30.0, 60.0], [5.0, 5.0], more=leg, **place)) == ()


@pytest.mark.parametrize("command", ["validate", "simulate --out o --config"])
def test_the_commands_say_it(call, tmp_path, command):
    text = PATH.format(
        duration=0.1,
        start="north_m = 4.0",
        north=GOTO[0][0],
        east=GOTO[0][1],
        more="",
    )
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    code, _, err = call(*command.split(), "m.toml")
    assert code == 0
    assert "warning: the glider starts at (4, 0) m" in err
    assert "warning: waypoints as (4123.456, -7032.351) look like degrees" in err


@pytest.mark.parametrize(
    ("key", "table"),
    [
        ("lat_deg", "reference.waypoints"),
        ("longitude", "reference.waypoints"),
        ("start_lat", "reference.waypoints"),
        ("lat_deg", "initial_state"),
    ],
)
def test_latitudes_are_refused_with_what_to_give_instead(call, tmp_path, key, table):
    text = f"[{table}]\n{key} = [41.0]\n"
    if table != "initial_state":
        text = f'[reference]\ntype = "waypoints"\n{text}'
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    code, _, err = call("validate", "m.toml")
    assert code == 2
    assert f"unknown key {table}.{key}; positions are north_m and east_m, metres" in err
    assert "or latitude_deg and longitude_deg, decimal degrees" in err
