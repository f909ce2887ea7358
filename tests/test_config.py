"""Mission files: what is left out, what is read, and what is refused in which words."""

import copy
import dataclasses
import json
import math
import re
import tomllib

import equinox as eqx
import jax
import numpy as np
import pytest
import tomli_w

from jaxglider import paper
from jaxglider.control import SMC, AbstractController, ControlRecord, FxTPPC
from jaxglider.control.controller import tracking_error
from jaxglider.control.observer import FixedTimeObserver, NoObserver
from jaxglider.core.toml import ConfigError
from jaxglider.environment.disturbances import GaussMarkov
from jaxglider.files.codec import encode
from jaxglider.files.file_kinds import refuse_other_kind
from jaxglider.files.flight.missions import mission_names, mission_path
from jaxglider.files.gains import decode_gains, encode_law, load_gains
from jaxglider.files.mission import (
    TEMPLATE,
    build_mission,
    load_mission,
    self_contained,
)
from jaxglider.files.uncertainty import load_uncertainty
from jaxglider.guidance import LineOfSight, WaypointPath
from jaxglider.signals import Command
from jaxglider.simulation.checks.start import start_warnings
from jaxglider.vehicle.published import vehicle_names, vehicle_text
from tuning.problem.gain_sets import resolve
from tuning.problem.objective_file import read_objective

PLAIN = tomllib.loads(TEMPLATE())
KEY = jax.random.key(0)


def _uncommented():
    """The template with all its commented-out settings enabled but the gains file."""
    setting = re.compile(r"# (\[+[a-z._]+\]+|(?!gains_file)\w+ = )")
    lines = [
        line[2:] if setting.match(line) else line for line in TEMPLATE().splitlines()
    ]
    return tomllib.loads("\n".join(lines))


def _with_waypoints():
    """The template with its waypoint block enabled and the type set."""
    start = TEMPLATE().index("# [reference.waypoints]")
    end = TEMPLATE().index("\n\n", start)
    block = TEMPLATE()[start:end].replace("\n# ", "\n").removeprefix("# ")
    text = TEMPLATE()[:start] + block + TEMPLATE()[end:]
    return tomllib.loads(text.replace('type = "schedule" ', 'type = "waypoints"', 1))


FULL = _uncommented()
FULL["reference"]["type"] = "waypoints"


def _leaves(data, path=()):
    """Every value of nested tables and lists with its path."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _leaves(value, (*path, key))
    elif isinstance(data, list):
        for number, value in enumerate(data):
            yield from _leaves(value, (*path, number))
    else:
        yield path, data


def _tables(data, path=()):
    if isinstance(data, dict):
        yield path
        for key, value in data.items():
            yield from _tables(value, (*path, key))
    elif isinstance(data, list):
        for number, value in enumerate(data):
            yield from _tables(value, (*path, number))


def _name(path):
    """disturbance[0].period_s[2], as a message names it."""
    text = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path)
    return text.removeprefix(".")


def _changed(data, path, value):
    data = copy.deepcopy(data)
    table = data
    for step in path[:-1]:
        table = table.setdefault(step, {}) if isinstance(step, str) else table[step]
    table[path[-1]] = value
    return data


def _refusal(data, tmp_path):
    """The message for a mission, without the name of its file."""
    file = tmp_path / "wrong.toml"
    file.write_text(data if isinstance(data, str) else tomli_w.dumps(data))
    with pytest.raises(ConfigError) as caught:
        load_mission(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    return message.removeprefix(f"{file}: ")


NUMBERS = [path for path, v in _leaves(FULL) if isinstance(v, int | float)]
TEXTS = [path for path, v in _leaves(FULL) if isinstance(v, str)]


def _equal(one, other):
    """Every number of two loops, to a unit in the last place (degrees, periods)."""
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(a, b, rtol=3e-16, atol=0.0)


def _calm(loop):
    return eqx.tree_at(lambda at: at.scenario.disturbance, loop, None)


def test_the_template_is_the_papers_switching_case():
    mission = build_mission(PLAIN)
    printed = paper.make_loop("switching")
    assert (mission.name, mission.seed, mission.controller) == ("mission", 0, "fxtppc")
    _equal(_calm(mission.loop), _calm(printed))
    _equal(mission.loop.scenario.sea(KEY), printed.scenario.sea(KEY))
    assert mission.loop.scenario.clock.ticks == 16000


def test_the_template_writes_out_the_papers_sea():
    (sine,) = build_mission(PLAIN).loop.scenario.disturbance.terms
    np.testing.assert_array_equal(
        sine.amplitude.fields(), [0.02, 0.01, -0.02, 0.01, 0.02, -0.01]
    )
    np.testing.assert_allclose(
        sine.frequency.fields(), np.pi / np.array([100, 100, 150, 100, 100, 100])
    )


def test_an_empty_file_is_the_papers_switching_case_in_calm_water():
    mission = build_mission({})
    _equal(_calm(mission.loop), _calm(paper.make_loop("switching")))
    for path in mission.loop.scenario.sea(KEY).fields():
        assert not np.any(path)


def test_the_templates_waypoints_are_the_papers_second_case():
    path = build_mission(_with_waypoints()).loop.scenario.reference
    printed = paper.reference("waypoints")
    assert isinstance(path, WaypointPath)
    np.testing.assert_array_equal(path.north, [10.0, 15.0, 30.0, 50.0, 50.0])
    np.testing.assert_array_equal(path.east, [5.0, -10.0, -15.0, -5.0, 10.0])
    for name in ("north", "east", "radius", "start_north", "start_east"):
        np.testing.assert_array_equal(getattr(path, name), getattr(printed, name))
    _equal(path.line_of_sight, printed.line_of_sight)
    for name in ("start", "gliding_angle", "depth_rate"):
        np.testing.assert_allclose(
            getattr(path.vertical, name),
            getattr(printed.vertical, name)[:4],
            rtol=3e-16,
        )


def test_a_waypoint_is_taken_abeam_only_if_the_file_says_so():
    data = _with_waypoints()
    del data["reference"]["waypoints"]["abeam_m"]
    assert build_mission(data).loop.scenario.reference.abeam is None
    data["reference"]["waypoints"]["abeam_m"] = 12.0
    assert float(build_mission(data).loop.scenario.reference.abeam) == 12.0


def test_waypoints_alone_bring_the_rest_of_the_papers_second_case():
    data = {"reference": {"type": "waypoints"}}
    data["reference"]["waypoints"] = {
        key: _with_waypoints()["reference"]["waypoints"][key]
        for key in ("north_m", "east_m")
    }
    data["initial_state"] = {"east_m": 3.0}
    data["clock"] = {"duration_s": 1200.0}
    loop = build_mission(data).loop
    _equal(_calm(loop), _calm(paper.make_loop("waypoints")))


def test_every_commented_out_setting_of_the_template_can_be_enabled():
    loop = build_mission(FULL).loop
    buoyancy = loop.scenario.actuators.buoyancy_mass
    assert (float(buoyancy.rate_limit), float(buoyancy.time_constant)) == (0.02, 5.0)
    angle = loop.scenario.actuators.mass_angle
    assert (float(angle.rate_limit), float(angle.time_constant)) == (0.2, 1.0)
    position = loop.scenario.actuators.mass_position
    assert (float(position.dead_band), float(angle.dead_band)) == (0.001, 0.02)
    kinds = [type(term).__name__ for term in loop.scenario.disturbance.terms]
    assert kinds == ["Sinusoid", "GaussMarkov", "Constant"]
    noise = loop.scenario.disturbance.terms[1]
    assert isinstance(noise, GaussMarkov)
    assert float(noise.correlation_time.yaw) == 10.0
    assert float(loop.scenario.plant.parameters.lift_slope) == 440.99
    assert len(NUMBERS) > 60


def test_angles_in_degrees_arrive_in_radians():
    data = {"initial_state": {"pitch_deg": -30.0, "yaw_rate_deg_s": 1.8, "sway_m_s": 2}}
    state = build_mission(data).loop.scenario.initial_state
    np.testing.assert_allclose(
        [state.pitch, state.yaw_rate, state.sway], [-np.pi / 6, np.pi / 100, 2.0]
    )


@pytest.mark.parametrize("path", NUMBERS, ids=_name)
def test_nan_is_refused_at_every_number(path, tmp_path):
    message = _refusal(_changed(FULL, path, math.nan), tmp_path)
    assert message.startswith(_name(path) + " must be ")
    assert message.endswith("received nan.")


@pytest.mark.parametrize("path", NUMBERS, ids=_name)
def test_text_is_refused_at_every_number(path, tmp_path):
    message = _refusal(_changed(FULL, path, "much"), tmp_path)
    assert message.startswith(_name(path) + " must be ")
    assert message.endswith("number; received 'much'.")


@pytest.mark.parametrize("path", TEXTS, ids=_name)
def test_a_number_is_refused_at_every_text(path, tmp_path):
    message = _refusal(_changed(FULL, path, 3), tmp_path)
    assert message.startswith(_name(path) + " must be ")
    assert message.endswith("received 3.")


@pytest.mark.parametrize("path", list(_tables(FULL)), ids=_name)
def test_an_unknown_key_is_refused_in_every_table(path, tmp_path):
    message = _refusal(_changed(FULL, (*path, "qqq"), 1.0), tmp_path)
    assert message.startswith(f"unknown key {_name((*path, 'qqq'))}; choose from ")


@pytest.mark.parametrize(
    "path", [p for p in _tables(FULL) if p and isinstance(p[-1], str)], ids=_name
)
def test_a_number_is_refused_in_place_of_every_table(path, tmp_path):
    message = _refusal(_changed(FULL, path, 3), tmp_path)
    assert message == f"{_name(path)} must be a table; received 3."


REFUSED = {
    ("nmae",): ("x", "unknown key nmae; did you mean name?"),
    ("seed",): (-1, "seed must be in [0, 4294967296); received -1."),
    ("clock", "duration_s"): (0, "clock", "duration", "positive", "0.0"),
    ("clock", "dt_s"): (-0.05, "clock", "dt", "in (0, 800]", "-0.05"),
    ("clock", "substeps"): (0, "clock", "substeps", "at least 1", "0"),
    ("vehicle", "data"): ("seewing", "vehicle.data", "seawing", ".toml", "'seewing'"),
    ("vehicle", "plant"): ("real", "vehicle.plant", "printed, rigid-body", "'real'"),
    ("vehicle", "design_factor"): (0, "vehicle.design_factor", "positive", "0.0"),
    ("vehicle", "parameters", "surge_mass"): (
        -1.0,
        "vehicle.parameters",
        "surge_mass must be positive; received -1.0",
    ),
    ("vehicle", "parameters", "surge_mas"): (1.0, "did you mean surge_mass?"),
    ("actuators", "mass_angle", "limit_rad"): (
        0,
        "actuators.mass_angle",
        "limit must be positive; received 0.0",
    ),
    ("actuators", "mass_angle", "limit_m"): (1, "did you mean limit_rad?"),
    ("actuators", "mass_position", "rate_limit_m_s"): (
        -1,
        "actuators.mass_position",
        "rate_limit must be positive; received -1.0",
    ),
    ("initial_state", "pitch_deg"): (
        90,
        "initial_state.pitch_deg must be in (-90, 90); received 90.",
    ),
    ("initial_state", "heading"): (1, "did you mean heading_deg?"),
    ("disturbance",): ({"type": "calm"}, "disturbance", "[[disturbance]]"),
    ("disturbance", 0, "type"): ("storm", "disturbance[0].type", "calm", "'storm'"),
    ("disturbance", 0, "period_s"): (
        0,
        "disturbance[0].period_s must be positive; received 0.",
    ),
    ("disturbance", 0, "amplitude_N"): (
        [0.1, 0.2],
        "disturbance[0].amplitude_N must have 3 numbers; received 2.",
    ),
    ("reference", "type"): ("loiter", "reference.type", "schedule, waypoints"),
    ("reference", "waypoints"): (
        {"north_m": [1.0], "east_m": [1.0]},
        'reference.type = "waypoints"',
        "Change the type",
    ),
    ("reference", "schedule", "start_s"): (
        [],
        "reference.schedule.start_s must have at least 1 number; received [].",
    ),
    ("reference", "schedule", "heading_deg"): (
        [1.0],
        "reference.schedule.heading_deg must have 4 numbers; received 1.",
    ),
    ("controller", "type"): ("lqg", "controller.type", "smc, ppc, fxtppc", "'lqg'"),
    ("controller", "exponents"): ("own", "controller.exponents", "paper, tian"),
    ("controller", "gains", "depth", "rho"): (
        1.0,
        "controller.gains.depth",
        "rho must be in (0, 1); received 1.0",
    ),
    ("controller", "funnel", "performance", "depth", "final_bound_m"): (
        0.7,
        "controller.funnel.performance.depth",
        "final_bound must be in (0, 0.648054); received 0.7",
        "lower final_bound or initial",
    ),
    ("controller", "funnel", "performance", "depth", "type"): (
        "cosh",
        "controller.funnel.performance.depth.type",
        "sech, exponential, ppc",
    ),
    ("observer", "type"): ("kalman", "observer.type", "none, fixed-time", "'kalman'"),
    ("observer", "smoothing"): (0, "observer", "smoothing must be positive", "0.0"),
}


@pytest.mark.parametrize("path", REFUSED, ids=_name)
def test_a_wrong_value_is_refused_by_path_rule_and_value(path, tmp_path):
    value, *parts = REFUSED[path]
    message = _refusal(_changed(PLAIN, path, value), tmp_path)
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("north", "east", "part"),
    [
        ([], [], "at least 1 waypoint"),
        ([1.0, 2.0], [1.0], "of one length"),
        ([10.0, 10.0, 20.0], [5.0, 5.0, 0.0], "waypoint 2 equals waypoint 1 (10.0, 5"),
        ([0.0], [0.0], "waypoint 1 equals the start of the path (0.0, 0.0)"),
    ],
)
def test_a_course_that_cannot_be_followed_is_refused(north, east, part, tmp_path):
    data = _with_waypoints()
    data["reference"]["waypoints"].update(north_m=north, east_m=east)
    message = _refusal(data, tmp_path)
    assert message.startswith("reference.waypoints: ")
    assert part in message


def test_waypoints_without_an_east_are_refused(tmp_path):
    data = {"reference": {"type": "waypoints", "waypoints": {"north_m": [1.0]}}}
    assert _refusal(data, tmp_path) == "reference.waypoints.east_m is missing."


@pytest.mark.parametrize(
    "clock", [{"duration_s": 1e300}, {"duration_s": 1e300, "dt_s": 1e-300}]
)
def test_a_run_that_cannot_fit_is_refused(clock, tmp_path):
    message = _refusal({"clock": clock}, tmp_path)
    assert "Clock.ticks must be at most 1e+08" in message
    assert "Shorten the run or lengthen the tick." in message


def test_infinity_and_huge_whole_numbers_are_refused(tmp_path):
    for text in ("inf", "-inf", "1e400", "1" + 400 * "0"):
        message = _refusal(f"[clock]\nduration_s = {text}\n", tmp_path)
        assert message.startswith("clock.duration_s must be finite; received ")


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"gone\.toml: no such file\."):
        load_mission(tmp_path / "gone.toml")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_mission(tmp_path)


def test_the_line_that_is_not_toml_is_named(tmp_path):
    message = _refusal('name = "x"\n\n[clock]\ndt_s 0.05\n', tmp_path)
    assert message.startswith("not valid TOML: ")
    assert "line 4" in message


def test_a_file_that_is_no_text_is_refused(tmp_path):
    file = tmp_path / "binary.toml"
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match=r"binary\.toml: cannot be read: .*utf-8"):
        load_mission(file)


def _gains_file(folder, kind="fxtppc", **more):
    loop = paper.make_loop("switching", controller=kind)
    data = {
        "format": 1,
        "controller": encode(loop.controller),
        "observer": encode(loop.observer),
        **more,
    }
    (folder / "gains.toml").write_text(tomli_w.dumps(data))
    return data


def test_files_in_a_mission_are_relative_to_its_folder(tmp_path, monkeypatch):
    data = _gains_file(tmp_path)
    data["controller"]["gains"]["depth"]["k1"] = 0.5
    data["observer"]["stretch"]["yaw"] = 7.0
    (tmp_path / "gains.toml").write_text(tomli_w.dumps(data))
    file = tmp_path / "mission.toml"
    file.write_text('[controller]\ngains_file = "gains.toml"\n')
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    mission = load_mission("../mission.toml")
    assert mission.controller == "fxtppc"
    assert float(mission.loop.controller.gains.depth.k1) == 0.5
    assert float(mission.loop.observer.stretch.yaw) == 7.0


def test_a_mission_overrides_its_gains_file(tmp_path):
    _gains_file(tmp_path)
    table = {"gains_file": "gains.toml", "gains": {"depth": {"k2": 0.25}}}
    mission = build_mission(
        {"controller": table, "observer": {"type": "none"}}, tmp_path
    )
    gains = mission.loop.controller.gains.depth
    assert (float(gains.k1), float(gains.k2)) == (0.001, 0.25)
    assert type(mission.loop.observer) is NoObserver


GUIDANCE = {"lookahead_m": 6.0, "integral_gain": 0.02}


def test_guidance_of_a_gains_file_is_that_of_a_path_without_its_own(tmp_path):
    _gains_file(tmp_path, guidance=GUIDANCE)
    table = {"controller": {"gains_file": "gains.toml"}}
    course = copy.deepcopy(_with_waypoints()["reference"])
    steered = build_mission(table | {"reference": course}, tmp_path)
    path = steered.loop.scenario.reference
    # The template's course has numbers of its own.
    assert float(path.line_of_sight.lookahead) == 2.5
    del course["waypoints"]["lookahead_m"]
    path = build_mission(table | {"reference": course}, tmp_path)
    found = path.loop.scenario.reference.line_of_sight
    assert (float(found.lookahead), float(found.integral_gain)) == (6.0, 0.01)


def test_gains_come_back_with_the_guidance_they_were_tuned_with():
    loop = paper.make_loop("waypoints")
    loop = eqx.tree_at(
        lambda at: at.scenario.reference.line_of_sight, loop, LineOfSight(6.0, 0.02)
    )
    tables = encode_law(loop)
    assert tables["guidance"] == GUIDANCE
    law = decode_gains(tables, "waypoints", loop.controller.model)
    again = law.on(paper.make_scenario("waypoints"))
    assert encode_law(again) == tables
    _equal(again.scenario.reference, loop.scenario.reference)
    # A schedule has no guidance: it stays as it is, and so does its gains file.
    schedule = paper.make_scenario("switching")
    assert eqx.tree_equal(law.on(schedule).scenario, schedule)
    assert "guidance" not in encode_law(law.on(schedule))


def test_a_mission_can_say_what_its_runs_are_judged_by():
    table = {"performance": {"depth": {"final_bound_m": 0.6}}}
    scenario = build_mission({"funnel": table}).loop.scenario
    depth = scenario.specification.funnel.performance.depth
    assert float(depth.final_bound) == 0.6
    assert float(depth.initial) == 1.0
    plain = build_mission(PLAIN).loop.scenario.specification
    assert eqx.tree_equal(plain.funnel, paper.funnel("switching"))


def test_a_self_contained_mission_needs_no_files(tmp_path):
    _gains_file(tmp_path, guidance=GUIDANCE)
    (tmp_path / "gains.toml").rename(tmp_path / "gains.txt")
    (tmp_path / "own.toml").write_text(vehicle_text("rogue"))
    course = {"type": "waypoints", "waypoints": {"north_m": [9.0], "east_m": [1.0]}}
    file = tmp_path / "mission.toml"
    data = {
        "vehicle": {"data": "own.toml", "plant": "rigid-body"},
        "controller": {"gains_file": "gains.txt"},
        "reference": course,
    }
    file.write_text(tomli_w.dumps(data))
    wanted, whole = load_mission(file), self_contained(file)
    for name in ("gains.txt", "own.toml", "mission.toml"):
        (tmp_path / name).unlink()
    found = build_mission(json.loads(json.dumps(whole)))
    assert (found.controller, found.plant) == (wanted.controller, wanted.plant)
    _equal(found.loop, wanted.loop)
    assert float(found.loop.scenario.reference.line_of_sight.lookahead) == 6.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vehicle": {"data": {"name": "x"}}}, "vehicle.data: the table: "),
        (
            {"controller": {"gains_file": {"controller": {"type": "lqg"}}}},
            "controller.gains_file: controller.type must be one of smc, ppc, fxtppc",
        ),
        ({"controller": {"gains_file": 3}}, "controller.gains_file must be text"),
    ],
)
def test_wrong_tables_in_the_place_of_files_are_named(change, message, tmp_path):
    assert _refusal(change, tmp_path).startswith(message)


def test_the_template_keeps_all_that_a_gains_file_says(tmp_path):
    """Its examples of gains would stand before the file, were they not comments."""
    loop = paper.make_loop("switching")
    law = jax.tree.map(lambda x: 0.9 * x, (loop.controller.gains, loop.observer))
    gains = {"type": "fxtppc", "gains": encode(law[0])}
    _gains_file(tmp_path, controller=gains, observer=encode(law[1]))
    text = TEMPLATE().replace(
        '# gains_file = "gains.toml"', 'gains_file = "gains.toml"'
    )
    (tmp_path / "mission.toml").write_text(text)
    found = load_mission(tmp_path / "mission.toml").loop
    assert encode(found.controller.gains) == encode(law[0])
    assert encode(found.observer) == encode(law[1])


def test_a_gains_file_of_another_kind_is_refused(tmp_path):
    _gains_file(tmp_path, "ppc")
    table = {"controller": {"type": "smc", "gains_file": "gains.toml"}}
    with pytest.raises(ConfigError) as caught:
        build_mission(table, tmp_path)
    for part in ("controller.type", "'ppc'", "gains.toml", "'smc'", "Change one"):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"controller": None}, "controller is missing."),
        ({"format": 2}, "format must be one of 1; received '2'."),
        (
            {"name": "m"},
            "unknown key name; choose from controller, estimator, format, guidance, ",
        ),
        ({"guidance": 3}, "guidance must be a table; received 3."),
        ({"guidance": {"lookahead": 3.0}}, "unknown key guidance.lookahead; did you "),
        ({"guidance": {"lookahead_m": 0.0}}, "guidance: LineOfSight.lookahead must be"),
        ({"controller": {"type": "lqg"}}, "controller.type must be one of smc, ppc"),
        ({"controller": {}}, "controller.type is missing."),
        ({"controller": 3}, "controller must be a table; received 3."),
        ({"observer": "none"}, "observer must be a table; received 'none'."),
    ],
)
def test_a_wrong_gains_file_is_refused_by_name(change, part, tmp_path):
    data = {**_gains_file(tmp_path), **change}
    data = {key: value for key, value in data.items() if value is not None}
    file = tmp_path / "gains.toml"
    file.write_text(tomli_w.dumps(data))
    loop = paper.make_loop("switching")
    with pytest.raises(ConfigError) as caught:
        load_gains(file, "switching", loop.controller.model)
    assert str(caught.value).startswith(f"{file}: {part}")


@pytest.mark.parametrize(
    ("kind", "controller", "observer"),
    [("smc", SMC, NoObserver), ("fxtppc", FxTPPC, FixedTimeObserver)],
)
def test_a_controller_brings_its_observer(kind, controller, observer):
    loop = build_mission({"controller": {"type": kind}}).loop
    assert (type(loop.controller), type(loop.observer)) == (controller, observer)
    other = "fixed-time" if observer is NoObserver else "none"
    table = {"controller": {"type": kind}, "observer": {"type": other}}
    assert type(build_mission(table).loop.observer) is not observer


def test_what_is_the_papers_for_want_of_a_table_is_said():
    assert build_mission(PLAIN).stand_ins == ""
    every = build_mission({}).stand_ins
    for table in (
        "vehicle: SeaWing",
        "reference: ",
        "controller: FxTPPC",
        "clock: 800",
    ):
        assert table in every
    one = build_mission({k: v for k, v in PLAIN.items() if k != "clock"}).stand_ins
    assert "clock" in one
    assert "vehicle" not in one
    course = _with_waypoints()
    assert build_mission(course).stand_ins == ""
    del course["reference"]["schedule"]
    assert "reference.schedule" in build_mission(course).stand_ins


class LooksDown(AbstractController):
    """A law that asks for less the nearer the bottom is."""

    model = None
    funnel = None

    def init(self):
        """No state."""
        return None

    def step(self, state, measurement, reference, bounds, dt):
        """The command."""
        error, _ = tracking_error(measurement, reference)
        zero = 0.0 * measurement.altitude
        return Command(zero, zero, zero), state, ControlRecord(error, error)


def test_a_law_is_told_before_the_flight_what_it_is_told_in_it():
    loop = build_mission(PLAIN | {"seabed": {"depth_m": 60.0}}).loop
    own = dataclasses.replace(loop, controller=LooksDown(), observer=NoObserver())
    assert start_warnings(own) == []


def test_a_start_inside_the_funnel_is_not_worth_a_warning():
    assert start_warnings(build_mission(PLAIN).loop) == []
    assert start_warnings(build_mission(_with_waypoints()).loop) == []


def test_a_start_outside_the_funnel_is_warned_of_by_channel_and_edges():
    edge = 1.0 / math.cosh(1.0 / math.cosh(1.0)) + 0.2
    for depth, outside in ((edge - 1e-6, False), (edge + 1e-6, True), (-3.0, True)):
        loop = build_mission({"initial_state": {"depth_m": depth}}).loop
        found = start_warnings(loop)
        above = [text for text in found if "above the surface" in text]
        assert len(above) == (depth < 0.0)
        found = [text for text in found if text not in above]
        assert len(found) == outside
        for warning in found:
            assert warning.startswith(f"the depth error starts at {depth:.4g}, outside")
            assert f"({-edge:.4g}, {edge:.4g})" in warning
            assert "the run goes on" in warning


def test_a_missing_key_is_told_beside_those_that_are_there(tmp_path):
    file = tmp_path / "m.toml"
    file.write_text('[[disturbance]]\ntype = "sinusoid"\nperiods_s = [10.0]\n')
    with pytest.raises(ConfigError, match=r"period_s is missing\. Other keys there: p"):
        load_mission(file)


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path, ending):
    """Every kind of file that a user writes, as some editors save it."""
    kinds = {
        "m": 'name = "a"\nvehicle = {data = "v.toml"}\n'
        'controller = {gains_file = "g.toml"}\n',
        "g": '[controller]\ntype = "smc"\n',
        "u": '[[vehicle]]\nlaw = "uniform"\nhalf_width = 0.1\n',
        "o": "[weights]\nroll = 1.0\n",
        "v": vehicle_text("seawing"),
    }
    for name, text in kinds.items():
        data = b"\xef\xbb\xbf" + text.replace("\n", ending).encode()
        (tmp_path / f"{name}.toml").write_bytes(data)
    mission = load_mission(tmp_path / "m.toml")
    assert (mission.name, mission.controller) == ("a", "smc")
    uncertain = load_uncertainty(tmp_path / "u.toml", mission.loop.scenario)
    assert uncertain.names()
    assert read_objective(tmp_path / "o.toml")[0].roll == 1.0
    (one,) = resolve([str(tmp_path / "g.toml")], [], "switching", "printed")
    assert one.label == "smc (g)"


def test_a_vehicle_that_is_not_there_is_told_with_where_and_what_else(tmp_path):
    file = tmp_path / "mission.toml"
    file.write_text('[vehicle]\ndata = "mine.toml"\n')
    with pytest.raises(ConfigError) as caught:
        load_mission(file)
    message = str(caught.value)
    names = "rogue, seaglider, seawing, slocum, slocum-comet, slocum-graver"
    assert message.startswith(f"{file}: vehicle.data must be {names} or")
    assert f"{tmp_path}/mine.toml cannot be read: no such file or directory" in message
    assert "Errno" not in message


@pytest.mark.parametrize(
    ("tables", "kind"),
    [
        ({"format": 1, "controller": {"type": "smc"}}, "a gains"),
        ({"weights": {"tracking": 1.0}}, "an objective"),
        ({"sensors": {}, "vehicle": []}, "an uncertainty"),
        *((tomllib.loads(vehicle_text(name)), "a vehicle") for name in vehicle_names()),
    ],
)
def test_a_file_of_another_kind_is_no_mission(tables, kind):
    with pytest.raises(ConfigError, match=f"this is {kind} file, not a mission file"):
        build_mission(tables)


@pytest.mark.parametrize("name", [None, *mission_names()])
def test_every_mission_is_told_from_a_file_of_gains(name):
    text = TEMPLATE() if name is None else mission_path(name).read_text()
    tables = tomllib.loads(text) | {"specification": {}}
    with pytest.raises(ConfigError, match="this is a mission file, not a gains file"):
        refuse_other_kind(tables, "gains")
