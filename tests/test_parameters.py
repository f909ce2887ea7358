import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxglider.vehicle.parameters import UNCERTAIN, GliderParameters
from jaxglider.vehicle.published import load_vehicle, vehicle_names, vehicle_text

# The paper's table of parameters; buoyancy position and gravity are not in it.
PRINTED = {
    "moving_mass": 11.0,
    "mass_offset": 0.014,
    "surge_mass": 66.76,
    "sway_mass": 114.86,
    "heave_mass": 131.20,
    "roll_inertia": 1.13,
    "pitch_inertia": 23.15,
    "yaw_inertia": 25.50,
    "drag": 7.19,
    "lift_offset": -0.36,
    "lift_slope": 440.99,
    "side_force_slope": -115.65,
    "roll_moment_slope": -58.27,
    "roll_damping": -19.83,
    "pitch_moment_offset": 0.28,
    "pitch_moment_slope": -65.84,
    "pitch_damping": -205.64,
    "yaw_moment_slope": 34.10,
    "yaw_damping": -389.30,
}
KNOWN = {"moving_mass", "mass_offset", "buoyancy_position", "gravity"}


def _numbers(parameters):
    return {
        field.name: float(getattr(parameters, field.name))
        for field in dataclasses.fields(parameters)
    }


@pytest.fixture
def write(tmp_path):
    """Write a vehicle file that differs from a good one, and return its path."""
    good = _numbers(load_vehicle("seawing").parameters)
    limits = {"buoyancy_mass": 0.4, "mass_position": 0.06, "mass_angle": 1.57}

    def to_file(parameters=None, more_limits=None, without=(), tail=""):
        lines = ["[parameters]"]
        for key, value in {**good, **(parameters or {})}.items():
            lines += [] if key in without else [f"{key} = {value}"]
        lines += ["[limits]"]
        for key, value in {**limits, **(more_limits or {})}.items():
            lines += [] if key in without else [f"{key} = {value}"]
        path = tmp_path / "mine.toml"
        path.write_text("\n".join([*lines, tail]))
        return path

    return to_file


def _refusal(path):
    with pytest.raises(ValueError, match=r".") as refusal:
        load_vehicle(path)
    return str(refusal.value)


def test_seawing_carries_the_printed_table():
    vehicle = load_vehicle("seawing")
    got = _numbers(vehicle.parameters)
    assert {k: v for k, v in got.items() if k in PRINTED} == PRINTED
    assert set(got) - set(PRINTED) == {"buoyancy_position", "gravity"}
    assert (got["buoyancy_position"], got["gravity"]) == (0.0, 9.81)
    limits = [float(x) for x in jax.tree.leaves(vehicle.limits)]
    np.testing.assert_allclose(limits, [0.4, 0.06, np.pi / 2], rtol=1e-15)
    assert vehicle.name == "SeaWing"
    assert "seawing" in vehicle_names()


def test_inertia_is_the_diagonal_in_the_order_of_the_axes():
    got = load_vehicle("seawing").parameters.inertia().fields()
    np.testing.assert_array_equal(got, [66.76, 114.86, 131.20, 1.13, 23.15, 25.50])


def test_scaling_leaves_what_is_known_alone():
    true = load_vehicle("seawing").parameters
    before, after = _numbers(true), _numbers(true.scaled(0.8))
    assert set(before) - set(UNCERTAIN) == KNOWN
    for name, value in before.items():
        assert after[name] == (value if name in KNOWN else 0.8 * value)


def test_every_parameter_is_a_traced_number():
    leaves = jax.tree.leaves(load_vehicle("seawing").parameters)
    assert len(leaves) == len(dataclasses.fields(GliderParameters)) == 21
    slopes = jax.grad(lambda p: sum(jax.tree.leaves(p)))(
        load_vehicle("seawing").parameters
    )
    assert all(float(slope) == 1.0 for slope in jax.tree.leaves(slopes))


def test_a_file_of_the_users_is_read_with_plain_or_annotated_numbers(write):
    entry = '{ value = 12, unit = "kg", source = "weighed" }'
    vehicle = load_vehicle(write({"moving_mass": entry, "drag": 8}))
    assert float(vehicle.parameters.moving_mass) == 12.0
    assert float(vehicle.parameters.drag) == 8.0
    assert float(vehicle.parameters.surge_mass) == 66.76
    assert vehicle.name.endswith("mine.toml")


def test_an_unknown_vehicle_is_refused_with_the_choices():
    text = _refusal("spray")
    assert "'spray'" in text
    assert "'seawing'" in text


def test_a_file_that_is_not_there_is_an_os_error(tmp_path):
    with pytest.raises(OSError, match="nowhere"):
        load_vehicle(tmp_path / "nowhere.toml")


def test_an_unknown_key_is_refused_by_file_and_name(write):
    path = write({"moving_maas": 1.0})
    text = _refusal(path)
    assert str(path) in text
    assert "unknown key parameters.moving_maas" in text
    assert "moving_mass" in text


def test_an_unknown_limit_is_refused_by_file_and_name(write):
    path = write(more_limits={"rudder": 0.3})
    text = _refusal(path)
    assert str(path) in text
    assert "unknown key limits.rudder" in text


@pytest.mark.parametrize(
    ("key", "table"), [("yaw_damping", "parameters"), ("mass_angle", "limits")]
)
def test_a_missing_key_is_refused_by_file_and_name(write, key, table):
    path = write(without=(key,))
    text = _refusal(path)
    assert str(path) in text
    assert f"{table}.{key} is missing" in text


@pytest.mark.parametrize("value", ['"heavy"', "true", "[1.0]", '{ unit = "kg" }'])
def test_a_value_that_is_no_number_is_refused_by_file_and_name(write, value):
    path = write({"surge_mass": value})
    text = _refusal(path)
    assert str(path) in text
    assert "parameters.surge_mass must be a number" in text


def test_a_file_that_is_not_toml_is_refused_with_its_line(write):
    path = write(tail="what = = this")
    text = _refusal(path)
    assert str(path) in text
    assert "line 27" in text


@pytest.mark.parametrize("table", ["parameters", "limits"])
def test_a_table_that_is_no_table_is_refused_by_file_and_name(tmp_path, write, table):
    path = Path(write())
    good = path.read_text()
    lines = good.splitlines()
    at = lines.index("[limits]")
    kept = lines[at:] if table == "parameters" else lines[:at]
    path.write_text("\n".join([f"{table} = 3", *kept]))
    text = _refusal(path)
    assert str(path) in text
    assert table in text


@pytest.mark.parametrize(
    ("name", "bad", "rule"),
    [
        ("surge_mass", -66.76, "positive"),
        ("yaw_inertia", 0.0, "positive"),
        ("gravity", -9.81, "positive"),
        ("drag", -1.0, "zero or positive"),
        ("mass_offset", -0.01, "zero or positive"),
        ("heave_mass", float("nan"), "(positive|finite)"),
        ("lift_slope", float("nan"), "finite"),
        ("pitch_damping", float("inf"), "finite"),
    ],
)
def test_an_impossible_number_is_refused_by_name_and_value(name, bad, rule):
    good = load_vehicle("seawing").parameters
    pattern = rf"GliderParameters\.{name} must be {rule}; received {bad:g}"
    with pytest.raises(ValueError, match=pattern):
        dataclasses.replace(good, **{name: bad})


@pytest.mark.parametrize(
    ("name", "bad"), [("surge_mass", -66.76), ("lift_slope", float("nan"))]
)
def test_an_impossible_number_in_a_file_points_to_that_file(write, name, bad):
    path = write({name: bad})
    text = _refusal(path)
    assert f"{name} must be" in text
    assert str(path) in text


def test_signs_that_the_model_leaves_open_are_accepted():
    good = load_vehicle("seawing").parameters
    changed = dataclasses.replace(good, drag=0.0, lift_offset=0.4, yaw_damping=1.0)
    assert float(changed.drag) == 0.0


@pytest.mark.parametrize("unit", ["lb", "g", "kg m", 3])
def test_a_unit_that_is_not_the_keys_own_is_refused(tmp_path, unit):
    file = tmp_path / "own.toml"
    shown = f'"{unit}"' if isinstance(unit, str) else unit
    old = 'surge_mass = { value = 66.76, unit = "kg"'
    assert old in vehicle_text("seawing")
    new = old.replace('"kg"', str(shown))
    file.write_text(vehicle_text("seawing").replace(old, new))
    with pytest.raises(ValueError, match=r"surge_mass must be in kg") as caught:
        load_vehicle(file)
    assert f"received unit = {unit!r}" in str(caught.value)


def test_a_unit_may_be_spelt_with_signs_and_every_shipped_one_is_right(tmp_path):
    file = tmp_path / "own.toml"
    for name in vehicle_names():
        text = vehicle_text(name).replace("kg m^2", "kg·m²")
        file.write_text(text)
        assert _numbers(load_vehicle(file).parameters) == _numbers(
            load_vehicle(name).parameters
        )


def test_a_vehicle_may_say_how_far_its_numbers_may_be_off(tmp_path):
    text = vehicle_text("slocum")
    assert load_vehicle("slocum").deviations["parameters.drag"] == 2.0
    assert load_vehicle("slocum-graver").deviations == {}
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(
        text.replace("standard_deviation = 2.0", "standard_deviation = 0.0")
    )
    with pytest.raises(ValueError, match=r"^[^:]*: parameters\.roll_inertia: standard"):
        load_vehicle(wrong)


def test_the_measured_slocum_glides_as_slowly_as_it_does():
    # Of comet: 231 cm^3 either way give 27 to 34 cm/s at a pitch of 22 degrees.
    measured, thesis = load_vehicle("slocum"), load_vehicle("slocum-graver")
    ratio = measured.parameters.drag / thesis.parameters.drag
    assert float(ratio) == pytest.approx(7.8 / 2.15)
    body = measured.body
    assert float(body.displaced_mass(measured.parameters)) == pytest.approx(70.0)
