"""Results on disk: complete or not there at all, and the numbers of the run."""

import importlib.metadata
import json
import os
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import netCDF4
import numpy as np
import pytest
import xarray
from cf_checker import VERSIONS, complaints

from jaxglider import paper
from jaxglider.files.results import metrics_dict, write_trajectories
from jaxglider.files.writing import provenance, replacing, write_json, write_text

TICKS, SHORT, ENDED = 100, 60, 40
STATES = {
    "north": "m",
    "east": "m",
    "depth": "m",
    "roll": "rad",
    "pitch": "rad",
    "heading": "rad",
    "surge": "m s-1",
    "sway": "m s-1",
    "heave": "m s-1",
    "roll_rate": "rad s-1",
    "pitch_rate": "rad s-1",
    "yaw_rate": "rad s-1",
}
CHANNEL_UNITS = {"depth": "m", "pitch": "rad", "heading": "rad"}
COMMAND_UNITS = {"buoyancy_mass": "kg", "mass_position": "m", "mass_angle": "rad"}
AXIS_UNITS = {
    **dict.fromkeys(("surge", "sway", "heave"), "N"),
    **dict.fromkeys(("roll", "pitch", "yaw"), "N m"),
}


@pytest.fixture(scope="module")
def run(simulate_jit):
    loop = paper.make_loop("switching", duration=TICKS * 0.05)
    return jax.device_get(simulate_jit(loop, loop.scenario.sea(jax.random.key(0))))


@pytest.fixture(scope="module")
def marked(run):
    """The run with numbers that tell every column from every other."""
    rng = np.random.default_rng(0)
    ticks = jax.tree.map(
        lambda x: rng.normal(size=x.shape) if x.dtype == np.float64 else x, run.ticks
    )
    ticks = eqx.tree_at(lambda t: t.time, ticks, run.ticks.time)
    return eqx.tree_at(lambda r: r.ticks, run, ticks)


@pytest.fixture(scope="module")
def runs(marked):
    """A whole run, one cut short, and one whose mission ended before its horizon."""
    short = eqx.tree_at(
        lambda r: r.ticks, marked, jax.tree.map(lambda x: x[:SHORT], marked.ticks)
    )
    active = np.arange(TICKS) < ENDED
    ended = eqx.tree_at(lambda r: r.ticks.active, marked, active)
    return {"a/printed/fxtppc": marked, "b/printed/ppc": short, "c/printed/smc": ended}


@pytest.fixture(scope="module")
def file(runs, tmp_path_factory):
    path = tmp_path_factory.mktemp("io") / "new" / "folder" / "trajectories.nc"
    write_trajectories(path, runs, {"seed": 3, "created": "now", "note": "ρ"})
    with netCDF4.Dataset(path) as data:
        yield data


def _columns(ticks):
    """Every number of a tick under the name and unit it should have in the file."""
    for name, unit in STATES.items():
        yield name, unit, getattr(ticks.state, name)
    for name, unit in CHANNEL_UNITS.items():
        yield f"{name}_reference", unit, getattr(ticks.reference, name)
        yield f"{name}_error", unit, getattr(ticks.error, name)
        yield f"{name}_lower_bound", unit, getattr(ticks.limits, name).lower
        yield f"{name}_upper_bound", unit, getattr(ticks.limits, name).upper
        for edge in ("lower", "upper"):
            own = getattr(getattr(ticks.law_limits, name), edge)
            yield f"{name}_{edge}_law_bound", unit, own
    for name, unit in COMMAND_UNITS.items():
        yield f"{name}_wanted", unit, getattr(ticks.wanted, name)
        yield f"{name}_applied", unit, getattr(ticks.applied, name)
    for name, unit in AXIS_UNITS.items():
        yield f"{name}_estimate", unit, getattr(ticks.estimate, name)
        yield f"{name}_lumped", unit, getattr(ticks.lumped, name)
        yield f"{name}_disturbance", unit, getattr(ticks.disturbance, name)
    yield "target", "1", ticks.target
    yield "clock", "s", ticks.clock


def test_dimensions_are_runs_and_the_longest_time(file, runs):
    assert {name: len(d) for name, d in file.dimensions.items()} == {
        "run": 3,
        "time": TICKS,
    }
    assert list(file["run_name"][:]) == list(runs)
    np.testing.assert_array_equal(file["time"][:], np.arange(TICKS) * 0.05)
    assert file["time"].axis == "T"
    start, end = netCDF4.num2date(file["time"][[0, -1]], file["time"].units)
    assert (end - start).total_seconds() == pytest.approx((TICKS - 1) * 0.05)
    assert start.isoformat() == "2000-01-01T00:00:00"


def test_every_number_of_the_trajectory_is_in_the_file_with_its_unit(file, marked):
    expected = {name: (unit, values) for name, unit, values in _columns(marked.ticks)}
    assert set(file.variables) == {"run_name", "time", *expected}
    for name, (unit, values) in expected.items():
        variable = file[name]
        assert (variable.dimensions, variable.dtype) == (("run", "time"), np.float64)
        assert variable.units == unit
        np.testing.assert_array_equal(variable[0], values)


def test_a_short_run_and_an_ended_mission_are_padded_with_the_fill_value(file, marked):
    for name, _, values in _columns(marked.ticks):
        variable = file[name]
        assert np.isnan(variable._FillValue)
        for row, end in ((1, SHORT), (2, ENDED)):
            column = variable[row]
            np.testing.assert_array_equal(column[:end], values[:end])
            assert np.all(np.isnan(np.ma.filled(column[end:], np.nan)))


def test_attributes_follow_the_cf_conventions(file):
    assert all(re.fullmatch(r"CF-1\.\d+", x) for x in file.Conventions.split())
    assert file.title
    assert "jaxglider" in file.source
    assert file.history.startswith("now")
    for name, variable in file.variables.items():
        assert variable.long_name, name
    assert file["depth"].standard_name == "depth"
    assert file["depth"].positive == "down"
    assert file["pitch"].standard_name == "platform_pitch_fore_up"
    assert file["roll"].standard_name == "platform_roll_starboard_down"
    assert file["depth_error"].coordinates == "run_name"


def test_the_checker_of_the_conventions_finds_nothing(runs, tmp_path):
    path = tmp_path / "t.nc"
    write_trajectories(path, runs, {"created": "now"})
    assert complaints(path) == []


def test_xarray_opens_the_file_with_times_and_names(runs, tmp_path):
    write_trajectories(tmp_path / "t.nc", runs, {})
    with xarray.open_dataset(tmp_path / "t.nc") as data:
        assert data["run_name"].values.tolist() == list(runs)
        tick = (data["time"][1] - data["time"][0]) / np.timedelta64(1, "ms")
        assert float(tick) == pytest.approx(50.0)
        chosen = data.swap_dims(run="run_name").sel(run_name="b/printed/ppc")
        assert int(chosen["depth"].count()) == SHORT


def test_the_checker_would_find_what_is_wrong(runs, tmp_path):
    path = tmp_path / "t.nc"
    write_trajectories(path, runs, {})
    with netCDF4.Dataset(path, "a") as data:
        data["time"].units = "s"
        data["roll"].standard_name = "platform_rolling"
    found = complaints(path, VERSIONS[:1])
    assert any("time units" in text for text in found)
    assert any("platform_rolling" in text for text in found)


def test_provenance_is_kept_in_the_file(file):
    assert json.loads(file.provenance) == {"seed": 3, "created": "now", "note": "ρ"}


def test_single_precision_stays_single(run, tmp_path):
    single = jax.tree.map(
        lambda x: x.astype(np.float32) if x.dtype == np.float64 else x, run
    )
    write_trajectories(tmp_path / "t.nc", {"run": single}, {})
    with netCDF4.Dataset(tmp_path / "t.nc") as data:
        assert data["depth_error"].dtype == np.float32
        np.testing.assert_array_equal(data["depth_error"][0], single.ticks.error.depth)


def test_a_trajectory_that_cannot_be_written_leaves_the_old_file(runs, tmp_path):
    path = tmp_path / "trajectories.nc"
    write_trajectories(path, runs, {})
    before = path.read_bytes()
    broken = eqx.tree_at(lambda r: r.ticks.state, runs["a/printed/fxtppc"], None)
    with pytest.raises(AttributeError):
        write_trajectories(path, {"x": broken}, {})
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["trajectories.nc"]


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt, SystemExit])
def test_an_interrupted_write_leaves_the_old_file(error, tmp_path):
    path = tmp_path / "metrics.json"
    path.write_text("old")

    def interrupted():
        with replacing(path) as temporary:
            temporary.write_text("half of the n")
            assert path.read_text() == "old"
            raise error

    with pytest.raises(error):
        interrupted()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["metrics.json"]


def test_a_reader_of_the_old_file_never_sees_the_new_one(tmp_path):
    path = tmp_path / "text"
    write_text(path, "old")
    with path.open() as reader:
        write_text(path, "new, and longer")
        assert reader.read() == "old"
    assert path.read_text() == "new, and longer"


def test_a_new_file_has_the_mode_that_the_user_asks_for(tmp_path):
    old = os.umask(0o027)
    try:
        write_text(tmp_path / "text", "x")
    finally:
        os.umask(old)
    assert (tmp_path / "text").stat().st_mode & 0o777 == 0o640


def test_a_folder_that_cannot_be_made_is_an_os_error(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(OSError, match="file"):
        write_text(tmp_path / "file" / "text", "y")
    assert (tmp_path / "file").read_text() == "x"


def test_json_never_holds_nan(tmp_path):
    path = tmp_path / "metrics.json"
    write_json(path, {"a": [1, None]})
    assert json.loads(path.read_text()) == {"a": [1, None]}
    with pytest.raises(ValueError, match="JSON"):
        write_json(path, {"a": float("nan")})
    assert json.loads(path.read_text()) == {"a": [1, None]}


def test_metrics_become_plain_numbers_under_the_agreed_names(run):
    plain = metrics_dict(run.metrics, has_waypoints=False)
    assert set(plain) >= {
        "end_time_s",
        "finite",
        "channels",
        "max_roll_rad",
        "waypoints_reached",
    }
    assert list(plain["channels"]) == ["depth", "pitch", "heading"]
    for name, channel in plain["channels"].items():
        assert set(channel) >= {
            "max_error",
            "max_error_settled",
            "rms_error",
            "rms_effort",
            "chattering",
            "time_outside_funnel",
        }
        error = getattr(run.ticks.error, name)
        assert channel["max_error"] == np.max(np.abs(error))
        np.testing.assert_allclose(
            channel["rms_error"], np.sqrt(np.mean(error**2)), rtol=1e-12
        )
    assert plain["end_time_s"] == pytest.approx(5.0)
    assert plain["max_roll_rad"] == np.max(np.abs(run.ticks.state.roll))
    assert plain["finite"] is True
    assert plain["waypoints_reached"] is None
    assert json.loads(json.dumps(plain)) == plain


def test_waypoints_are_counted_where_there_are_any(run):
    metrics = eqx.tree_at(
        lambda m: m.waypoints_reached, run.metrics, jnp.asarray(3, jnp.int32)
    )
    assert metrics_dict(metrics, has_waypoints=True)["waypoints_reached"] == 3


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_becomes_null(run, value):
    metrics = eqx.tree_at(
        lambda m: (m.channels.pitch.rms_error, m.max_roll),
        run.metrics,
        (np.float64(value), np.float64(value)),
    )
    plain = metrics_dict(metrics, has_waypoints=False)
    assert plain["channels"]["pitch"]["rms_error"] is None
    assert plain["max_roll_rad"] is None
    assert plain["channels"]["depth"]["rms_error"] > 0.0
    json.dumps(plain, allow_nan=False)


def test_provenance_names_versions_hardware_and_what_is_added():
    about = provenance(seed=7)
    assert about["seed"] == 7
    assert about["versions"]["jax"] == jax.__version__
    assert about["versions"]["jaxglider"] == importlib.metadata.version("jaxglider")
    assert about["hardware"]["backend"] == "cpu"
    assert about["hardware"]["cores"] == os.cpu_count()
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", about["created"])
    assert json.loads(json.dumps(about)) == about
