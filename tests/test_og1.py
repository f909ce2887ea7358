"""A simulated flight as OG-1.0: by the checkers of others, and by our own reader."""

import dataclasses
import datetime

import equinox as eqx
import jax
import netCDF4
import numpy as np
import pytest
from cf_checker import complaints

from jaxglider import paper
from jaxglider.core.toml import ConfigError
from jaxglider.environment.tables import DensityProfile
from jaxglider.environment.water import Stratification, Water
from jaxglider.files.records.og1 import identifier, write_og1
from jaxglider.files.records.og1_variables import og1_columns
from jaxglider.files.sea.places import Plane
from jaxglider.simulation.origin import Origin
from jaxglider.simulation.rollout import simulate
from tuning.identification.record.reading import read_record
from tuning.identification.record.uniform import missing_for, uniform

KIEL = (54.4, 10.2)
START = datetime.datetime(2024, 5, 1, 6, tzinfo=datetime.UTC)
TIME = np.arange(0.0, 3000.0, 0.5)
RATE = np.where((TIME // 500.0) % 2 == 0, 0.08, -0.08)
DEPTH = np.cumsum(RATE) * 0.5


@pytest.fixture(scope="module")
def scenario():
    plain = paper.make_loop("switching", plant="rigid-body", duration=10.0).scenario
    layers = Stratification(65.0, density_gradient=1e-4, neutral_depth=10.0)
    return dataclasses.replace(
        plain, origin=Origin(place=KIEL), water=Water(None, layers)
    )


@pytest.fixture(scope="module")
def run():
    """Three dives to 40 m, made of the shapes of a rollout; nothing is computed."""
    loop = paper.make_loop("switching", plant="rigid-body", duration=3000.0)
    shapes = eqx.filter_eval_shape(simulate, loop, loop.scenario.sea(jax.random.key(0)))
    blank = jax.tree.map(
        lambda x: np.zeros((len(TIME), *x.shape[1:]), x.dtype),
        eqx.filter(shapes, lambda x: hasattr(x, "shape")),
    )
    run = eqx.combine(blank, eqx.filter(shapes, lambda x: not hasattr(x, "shape")))
    places = {
        "time": TIME,
        "active": TIME < 2900.0,
        "state.depth": DEPTH,
        "state.north": 0.2 * TIME,
        "state.east": -0.1 * TIME,
        "state.pitch": -0.4 * np.sign(RATE),
        "state.heading": np.full(len(TIME), -0.1),
        "applied.buoyancy_mass": 0.2 * np.sign(RATE),
        "applied.mass_position": 0.01 * np.sign(RATE),
    }
    for path, values in places.items():
        run = eqx.tree_at(lambda r, p=path: _at(r.ticks, p), run, values)
    return run


def _at(tree, path):
    for name in path.split("."):
        tree = getattr(tree, name)
    return tree


@pytest.fixture(scope="module")
def path(run, scenario, tmp_path_factory):
    name = identifier("Kiel, one dive", START)
    path = tmp_path_factory.mktemp("og1") / f"{name}.nc"
    write_og1(path, run, scenario, "Kiel, one dive", START, {"created": "now"})
    return path


def test_the_file_has_the_name_that_og1_asks_for(path):
    assert path.name == "kiel--one-dive_20240501T060000_delayed.nc"


def test_the_checker_of_the_conventions_finds_nothing(path):
    assert complaints(path, ("cf:1.10",)) == []


def test_the_checker_of_og1_finds_nothing(path, monkeypatch):
    checker = pytest.importorskip("cc_plugin_og.checker").OGChecker()
    for name in dir(checker):
        # That of the vocabulary asks a server.
        if not name.startswith("check_") or name == "check_variables_og1_url":
            continue
        with netCDF4.Dataset(path) as file:
            found = getattr(checker, name)(file)
        for result in found if isinstance(found, list) else [found]:
            assert result.value[0] == result.value[1], result.msgs


MANDATORY = (
    "TIME",
    "LATITUDE",
    "LONGITUDE",
    "DEPTH",
    "TIME_GPS",
    "LATITUDE_GPS",
    "LONGITUDE_GPS",
    "TRAJECTORY",
    "WMO_IDENTIFIER",
    "PLATFORM_MODEL",
    "PLATFORM_SERIAL_NUMBER",
    "DEPLOYMENT_TIME",
    "DEPLOYMENT_LATITUDE",
    "DEPLOYMENT_LONGITUDE",
)


def test_what_the_manual_demands_is_there(path, run):
    with netCDF4.Dataset(path) as file:
        assert set(MANDATORY) <= set(file.variables)
        assert list(file.dimensions) == ["N_MEASUREMENTS"]
        assert file.featureType == "trajectory"
        assert file.id == path.stem
        assert file["TRAJECTORY"][...] == "kiel--one-dive_20240501T060000"
        assert file["TIME"][0] == START.timestamp() == file["DEPLOYMENT_TIME"][...]
        # Every second tick, until the mission ended.
        assert len(file["TIME"]) == 2900
        north, east = Plane(*KIEL).metres(file["LATITUDE"][:], file["LONGITUDE"][:])
        assert north[-1] == pytest.approx(0.2 * 2899.0, abs=0.01)
        assert east[-1] == pytest.approx(-0.1 * 2899.0, abs=0.01)
        assert file["HEADING"][0] == pytest.approx(360.0 - np.degrees(0.1), abs=1e-4)
        fixed = np.isfinite(np.ma.filled(file["TIME_GPS"][:], np.nan))
        depth = np.asarray(file["DEPTH"][:])
        assert np.all(depth[fixed] < 0.5)
        assert fixed.sum() >= 3


def test_our_reader_reads_it_and_it_can_be_fitted(path):
    record = read_record(path)
    assert record.kind == "OG-1.0"
    assert not record.warnings()
    assert not any(missing_for(record).values())
    volume = record.channels["ballast"].values
    assert volume.min() == pytest.approx(-0.2 / 1025.0, rel=1e-5)
    assert record.channels["mass_position"].values.max() == pytest.approx(0.01)
    depth, density = record.channels["depth"].values, record.channels["density"].values
    there = np.argmax(depth)
    expected = 1025.0 * (1.0 + 1e-4 * (depth[there] - 10.0))
    assert density[there] == pytest.approx(expected, rel=1e-6)
    assert uniform(record).dives() == 3


def test_density_is_that_of_the_profile(run, scenario):
    profile = DensityProfile([0.0, 40.0], [1005.0, 1009.0])
    water = Water(None, Stratification(65.0, neutral_depth=10.0, profile=profile))
    baltic = dataclasses.replace(scenario, water=water)
    columns = og1_columns(run, baltic, START)
    expected = np.clip(1005.0 + 0.1 * columns["DEPTH"], 1005.0, 1009.0)
    assert columns["DENSITY"] == pytest.approx(expected, rel=1e-6)
    assert columns["VBD_CC"].min() == pytest.approx(-0.2e6 / 1006.0, rel=1e-6)


def test_a_mission_that_is_nowhere_is_refused(run, scenario, tmp_path):
    nowhere = dataclasses.replace(scenario, origin=Origin())
    with pytest.raises(ConfigError, match=r"OG-1\.0 needs places on Earth"):
        write_og1(tmp_path / "a.nc", run, nowhere, "a", None, {})
    assert not list(tmp_path.iterdir())
