"""Missions that ship, against what the gliders did that they are of.

Figures of the shallow Slocum are of its flight record of 23 June 2016, 40 m yos; those
of the Seaglider of five dives of number 167 to 990 m. Tolerances stand with them.
"""

import dataclasses
import json
import math
import tomllib

import equinox as eqx
import jax
import numpy as np
import pytest
import tomli_w

from jaxglider.files.flight.missions import mission_names, mission_path
from jaxglider.files.mission import load_mission
from jaxglider.guidance.phases import APOGEE, STATUSES, SURFACE
from jaxglider.simulation.flight import halves
from jaxglider.simulation.rollout import simulate
from tuning.cli.main import main

SENSOR = 0.86
"""Share of what its own sensor reads that is true pitch, on the shallow Slocum."""
RUN = jax.jit(simulate)


def flown(loop):
    """A trajectory on the host."""
    return jax.device_get(RUN(loop, loop.scenario.sea(jax.random.key(0))))


def status(run):
    return STATUSES[int(run.metrics.status)]


@pytest.fixture(scope="module")
def slocum():
    return load_mission(mission_path("slocum-shallow")).loop


@pytest.fixture(scope="module")
def shallow(slocum):
    return flown(slocum)


@pytest.fixture(scope="module")
def seaglider():
    return flown(load_mission(mission_path("seaglider-990")).loop)


def of(rows, kind, key):
    return np.array([row[key] for row in rows if row["half"] == kind])


def test_the_shallow_slocum_dives_and_climbs_as_its_record(shallow):
    rows = halves(shallow)
    assert status(shallow) == "completed"
    assert len(rows) == 10
    # The record: dive 332 s and climb 301 s.
    np.testing.assert_allclose(of(rows, "dive", "duration_s"), 332.0, rtol=0.1)
    np.testing.assert_allclose(of(rows, "climb", "duration_s"), 301.0, rtol=0.1)
    np.testing.assert_allclose(of(rows, "climb", "overshoot_m"), 0.9, atol=0.5)
    # 43 s from the surface, 22 s at the apogee.
    assert of(rows, "dive", "settle_time_s")[0] == pytest.approx(43.0, abs=10.0)
    np.testing.assert_allclose(of(rows, "climb", "settle_time_s"), 22.0, atol=10.0)
    # 25 degrees as the sensor reads it, 1/0.86 too much.
    for kind, wanted in (("dive", -25.0), ("climb", 25.0)):
        read = np.degrees(of(rows, kind, "pitch_rad")) / SENSOR
        np.testing.assert_allclose(read, wanted, atol=1.5)
    rates = np.abs([row["depth_rate_m_s"] for row in rows])
    assert np.all((rates > 0.12) & (rates < 0.14))


def test_the_pump_of_the_slocum_takes_thirteen_seconds(slocum, shallow):
    pump = slocum.scenario.actuators.buoyancy_mass
    seconds = 2.0 * float(pump.limit) / float(pump.push_rate)
    assert seconds == pytest.approx(13.0, abs=2.0)
    ticks = shallow.ticks
    first = int(np.flatnonzero(np.asarray(ticks.phase) == APOGEE)[0])
    held = np.asarray(ticks.applied.buoyancy_mass)
    # Orders of the tick before: it has run for 4 s by its end, and for 12 s two later.
    rate = float(pump.push_rate)
    assert held[first - 1] - held[first] == pytest.approx(4.0 * rate, rel=1e-6)
    assert held[first + 2] - held[first + 3] < 4.0 * rate


def test_the_slocum_meets_its_waypoint(shallow):
    ticks, count = shallow.ticks, int(np.asarray(shallow.ticks.active).sum())
    end = count - 1
    place = float(ticks.state.north[end]), float(ticks.state.east[end])
    assert math.dist(place, (600.0, 400.0)) < 150.0
    assert int(shallow.metrics.waypoints_reached) == 1


def test_energy_is_what_the_closed_forms_say(slocum, shallow):
    flight, energy = shallow.metrics.flight, slocum.scenario.energy
    ticks = shallow.ticks
    active = np.asarray(ticks.active)
    held = np.concatenate([[0.0], np.asarray(ticks.applied.buoyancy_mass)])
    pushed = np.sum(np.maximum(held[:-1] - held[1:], 0.0)[active])
    assert flight.energy.pump == pytest.approx(45.0 / 0.0357 * pushed, rel=1e-9)
    placed = np.concatenate([[0.0], np.asarray(ticks.applied.mass_position)])
    travel = np.sum(np.abs(np.diff(placed))[active])
    assert flight.energy.position == pytest.approx(6000.0 * travel, rel=1e-9)
    stayed = 4.0 * np.sum((np.asarray(ticks.phase) == SURFACE) & active)
    under = 4.0 * np.sum(active) - stayed
    assert flight.energy.hotel == pytest.approx(1.8 * under, rel=1e-12)
    assert flight.energy.surface == pytest.approx(4.3 * stayed, rel=1e-12)
    assert flight.total_energy == pytest.approx(sum(vars(flight.energy).values()))
    assert float(energy.battery) == 7.8e6


def test_a_push_is_paid_by_the_depth_it_is_made_at():
    energy = load_mission(mission_path("seaglider-990")).loop.scenario.energy
    # Main pump: (16.2 + 0.0119 z)/0.94 J/cm^3; above 120 m (1.3 + 0.085 z)/1.93.
    cc = 1.027e-3
    for depth, each in ((990.0, 29.8), (550.0, 24.2), (100.0, 5.1), (0.0, 0.67)):
        joule = float(
            energy.push(
                jax.numpy.asarray(cc), jax.numpy.asarray(depth), jax.numpy.asarray(9.81)
            )
        )
        assert joule == pytest.approx(each, abs=0.15)
    plain = dataclasses.replace(energy, pump=None, boost=None)
    for depth, share in ((100.0, 0.08), (500.0, 0.2), (3000.0, 0.45)):
        joule = float(
            plain.push(
                jax.numpy.asarray(cc), jax.numpy.asarray(depth), jax.numpy.asarray(9.81)
            )
        )
        assert joule == pytest.approx(cc * 9.81 * depth / share, rel=1e-12)


def test_the_seaglider_dives_to_990_m_as_number_167(seaglider):
    flight = seaglider.metrics.flight
    assert status(seaglider) == "completed"
    minutes = float(seaglider.metrics.end_time) / 60.0
    assert 0.92 * 312.0 < minutes < 1.08 * 320.0
    assert float(flight.depth_rate) == pytest.approx(0.1, rel=0.1)
    assert 0.85 * 21.7e3 < float(flight.total_energy) < 1.15 * 24.6e3
    assert 0.85 * 12.7e3 < float(flight.energy.pump) < 1.15 * 14.5e3
    dive, climb = halves(seaglider)
    assert 3.0 < climb["overshoot_m"] < 6.0
    assert math.degrees(dive["pitch_rad"]) == pytest.approx(-16.6, abs=1.0)
    assert float(flight.through_water) == pytest.approx(5200.0, rel=0.1)


def changed(loop, where, value):
    """The loop with another number, so that no program is compiled again."""
    old = where(loop.scenario)
    new = jax.numpy.full_like(old, value)
    return eqx.tree_at(lambda one: where(one.scenario), loop, new)


@pytest.mark.parametrize(
    ("where", "value", "end"),
    [
        (lambda s: s.seabed.depth, 20.0, "bottom"),
        # Too heavy for water so light: the pump does not make it rise.
        (lambda s: s.water.stratification.neutral_depth, 200.0, "stall"),
        # Light enough to leave 40 m, too heavy to come up: it hangs on the way.
        (lambda s: s.reference.settings.climb.buoyancy_mass, -0.01, "hover"),
        (lambda s: s.reference.course.north, 1e5, "unfinished"),
        (lambda s: s.energy.battery, 2e3, "battery empty"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_missions_that_fail_end_with_a_status_that_says_so(slocum, where, value, end):
    loop = changed(slocum, where, value)
    if end == "bottom":
        loop = changed(loop, lambda s: s.reference.settings.altitude, 0.05)
    if end == "stall":
        loop = changed(loop, lambda s: s.seabed.depth, 500.0)
    run = flown(loop)
    assert status(run) == end
    assert bool(run.metrics.finite)


def test_a_mission_that_fails_has_exit_code_1_and_everything_written(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr("tuning.evaluation.runs.save_all", lambda *a, **k: [])
    tables = tomllib.loads(mission_path("slocum-shallow").read_text())
    tables["seabed"]["depth_m"] = 20.0
    tables["reference"]["yo"]["altitude_m"] = 0.05
    file = tmp_path / "shoal.toml"
    file.write_text(tomli_w.dumps(tables))
    assert main(["simulate", str(file), "--out", str(tmp_path / "out")]) == 1
    told = capsys.readouterr()
    assert "bottom: the glider met the bottom." in told.err
    assert "bottom: 0 dives" in told.out
    run = json.loads((tmp_path / "out" / "metrics.json").read_text())["runs"][0]
    assert run["status"] == "bottom"
    assert run["flight"]["energy_J"]["pump"] >= 0.0
    for name in ("tables.md", "trajectories.nc"):
        assert (tmp_path / "out" / name).exists()


def test_missions_are_listed_and_named(capsys):
    assert main(["missions"]) == 0
    listed = capsys.readouterr().out
    for name in mission_names():
        assert name in listed
    assert main(["missions", "--show", "slocum-shallow"]) == 0
    assert capsys.readouterr().out == mission_path("slocum-shallow").read_text()
    assert main(["validate", "seawing-spiral"]) == 0
    assert "seawing-spiral, slocum" in capsys.readouterr().out
    assert main(["missions", "--show", "slocum"]) == 2
    assert "must be one of seaglider-990" in capsys.readouterr().err


def test_a_mission_of_no_such_name_is_refused_with_the_nearest(capsys):
    with pytest.raises(SystemExit):
        main(["simulate", "--mission", "slocum-shalow"])
    assert "Did you mean slocum-shallow?" in capsys.readouterr().err
