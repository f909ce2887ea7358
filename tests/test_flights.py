"""Missions that ship, against what the gliders did that they are of.

Figures of the shallow Slocum are of its flight record of 23 June 2016, 40 m yos; those
of the Seaglider of five dives of number 167 to 990 m. Tolerances stand with them.
"""

import dataclasses
import itertools
import json
import math
import re
import tomllib

import equinox as eqx
import jax
import netCDF4
import numpy as np
import pytest
import tomli_w

from jaxglider import paper
from jaxglider.export.plant import PlantState, drift, truth_of
from jaxglider.files.flight.flight_variables import HALVES
from jaxglider.files.flight.missions import mission_names, mission_path
from jaxglider.files.gains import load_gains
from jaxglider.files.mission import load_mission
from jaxglider.files.results import write_trajectories
from jaxglider.guidance.phases import (
    APOGEE,
    CLIMB,
    COMPLETED,
    DIVE,
    INFLECTION,
    PHASES,
    STATUSES,
    SURFACE,
)
from jaxglider.paper.tuned import tuned_gains
from jaxglider.plotting.flight import PANELS, dive, dive_spans, energy, save_dives
from jaxglider.plotting.style import new_figure
from jaxglider.signals import BodyAxes, Channels, Command, GliderState, zeros
from jaxglider.simulation.flight import halves
from jaxglider.simulation.motion import integrate, integrate_moving
from jaxglider.simulation.rollout import evaluate, simulate
from jaxglider.simulation.scenario import Clock
from jaxglider.simulation.tick import TickInput, TickPlan
from jaxglider.vehicle.actuators import follow_all
from jaxglider.vehicle.design_model import InputGain
from jaxglider.vehicle.energy import Pump
from jaxglider.vehicle.full_plant import full_plant
from jaxglider.vehicle.published import load_vehicle
from tuning.cli.main import main
from tuning.problem.case import FlightCase

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


def test_the_ballast_is_set_once_and_only_the_mass_is_solved_for():
    """Against a least-squares solver of two unknowns, the ballast known."""
    rng = np.random.default_rng(3)
    rows = jax.numpy.asarray(rng.normal(size=(20, 12)))

    def solved(x):
        gain = InputGain(*x[:7])
        damping = Command(0.1, 0.2, 0.3)
        found = gain.solve_at(x[7], Channels(*x[8:11]), damping)
        alone = gain.position_at(x[7], Channels(*x[8:11]), damping, x[11])
        return found, alone

    found, alone = jax.jit(jax.vmap(solved))(rows)
    for n, x in enumerate(np.asarray(rows)):
        g = np.array([[x[2], x[3]], [x[5], x[6]]])
        left = x[9:11] - x[7] * np.array([x[1], x[4]])
        both = np.linalg.solve(g.T @ g + np.diag([0.2, 0.3]), g.T @ left)
        np.testing.assert_allclose(found.mass_position[n], both[0], rtol=1e-9)
        np.testing.assert_allclose(found.mass_angle[n], both[1], rtol=1e-9)
        one = x[2] * (left[0] - x[3] * x[11]) / (x[2] ** 2 + 0.2)
        np.testing.assert_allclose(alone.mass_position[n], one, rtol=1e-9)
    np.testing.assert_array_equal(found.buoyancy_mass, rows[:, 7])


def test_a_period_of_small_steps_is_as_many_ticks_with_the_command_held(slocum):
    """A tick of 4 s moves actuators and glider as eight ticks of 0.5 s do."""
    coarse = dataclasses.replace(slocum.scenario, clock=Clock.sampled(4.0, 4.0, 0.5))
    fine = dataclasses.replace(coarse, clock=Clock.lasting(4.0, 0.5))
    state = GliderState.at_rest(depth=20.0, pitch=-0.3, surge=0.3, heave=0.01)
    held, wanted = Command(0.2, 0.0, 0.1), Command(-0.2, 0.01, -0.2)
    calm = zeros(BodyAxes)

    def inputs(time):
        plan = TickPlan(jax.numpy.asarray(time), calm, None, None, None, None)
        return TickInput(plan, calm, None)

    whole = jax.jit(lambda: integrate_moving(coarse, state, held, wanted, inputs(0.0)))
    position, end = whole()

    def tick(carry, number):
        held, state = carry
        moved = follow_all(
            fine.actuators, held, wanted, fine.clock.dt, 0.0, state.depth
        )
        return (moved, integrate(fine, state, moved, inputs(0.5 * number))), None

    start = held, state
    (place, last), _ = jax.lax.scan(tick, start, jax.numpy.arange(8.0))
    for a, b in zip(
        jax.tree.leaves((position, end)), jax.tree.leaves((place, last)), strict=True
    ):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-14)


def test_the_exported_glider_moves_as_the_simulated_one(slocum, shallow):
    """Its actuators too move from step to step: strokes of the pump, and glides."""
    ticks, truth = shallow.ticks, truth_of(slocum)
    stroke = int(np.flatnonzero(np.asarray(ticks.phase) == APOGEE)[0])
    first = np.concatenate([np.arange(1, 6), np.arange(stroke - 2, stroke + 4)])
    calm = zeros(BodyAxes)

    def one(state, held, wanted, time):
        return drift(slocum, truth, PlantState(state, held, time), wanted, calm)

    def at(part, number):
        return jax.tree.map(lambda x: np.asarray(x)[number], part)

    after = jax.jit(jax.vmap(one))(
        at(ticks.state, first),
        at(ticks.applied, first - 1),
        at(ticks.wanted, first),
        at(ticks.time, first),
    )
    found = jax.tree.leaves((after.held, after.state))
    flown = jax.tree.leaves((at(ticks.applied, first), at(ticks.state, first + 1)))
    for a, b in zip(found, flown, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


def test_a_pump_runs_or_stands_at_rates_of_direction_and_depth():
    pump = Pump(
        0.65, push_rate=0.001, draw_rate=0.013, boost_rate=0.002, dead_band=0.002
    )
    one = jax.numpy.asarray(1.0)

    def after(held, wanted, depth):
        return float(pump.follow(held * one, wanted * one, 10.0 * one, 0.0, depth))

    assert after(0.1, -0.3, 500.0) == pytest.approx(0.09)
    assert after(0.1, -0.3, 50.0) == pytest.approx(0.08)
    assert after(0.1, 0.6, 50.0) == pytest.approx(0.23)
    assert after(0.1, 0.1015, 50.0) == 0.1
    assert after(-0.649, -2.0, 0.0) == -0.649
    assert after(0.1, 0.104, 50.0) == pytest.approx(0.104)


def test_a_fin_turns_the_glider_to_its_side_and_costs_no_roll_of_the_mass():
    plant = full_plant(load_vehicle("slocum-comet"))
    state = GliderState.at_rest(pitch=-0.37, surge=0.28)
    rate = plant.derivative(state, Command(0.2, 0.0, 0.2), zeros(BodyAxes))
    still = plant.derivative(state, Command(0.2, 0.0, 0.0), zeros(BodyAxes))
    yaw = float(rate.yaw_rate - still.yaw_rate)
    # N = K_Nd d V^2 over the inertia about the vertical, sway and roll aside.
    assert yaw == pytest.approx(2.8 * 0.2 * 0.28**2 / 19.0, rel=0.1)
    assert float(rate.sway) < float(still.sway)
    assert float(rate.pitch_rate) == pytest.approx(float(still.pitch_rate))


def test_records_of_every_nth_tick_are_those_ticks_and_metrics_are_of_all(
    slocum, shallow
):
    sea = slocum.scenario.sea(jax.random.key(0))
    run = jax.jit(lambda loop: simulate(loop, sea, keep_every=27))(slocum)
    every = jax.tree.map(lambda x: np.asarray(x)[::27], shallow.ticks)
    for a, b in zip(
        jax.tree.leaves((run.ticks, run.metrics)),
        jax.tree.leaves((every, shallow.metrics)),
        strict=True,
    ):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)
    with pytest.raises(ValueError, match="keep_every must divide the 1350 ticks"):
        simulate(slocum, sea, keep_every=7)


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
    assert (
        "must be one of paper-switching, paper-waypoints, seaglider-990"
        in capsys.readouterr().err
    )


def test_a_mission_of_no_such_name_is_refused_with_the_nearest(capsys):
    with pytest.raises(SystemExit):
        main(["simulate", "--mission", "slocum-shalow"])
    assert "did you mean slocum-shallow?" in capsys.readouterr().err


def test_a_file_holds_phases_energy_and_every_dive_with_units(shallow, tmp_path):
    path = tmp_path / "yos.nc"
    write_trajectories(path, {"yos": shallow}, {"created": "now"})
    active = np.asarray(shallow.ticks.active)
    with netCDF4.Dataset(path) as file:
        assert file["phase"].flag_meanings == " ".join(PHASES)
        told = np.ma.filled(file["phase"][0], -1)
        np.testing.assert_array_equal(
            told, np.where(active, np.asarray(shallow.ticks.phase), -1)
        )
        assert file["pump_energy"].units == "J"
        np.testing.assert_array_equal(
            file["pump_energy"][0][active],
            np.asarray(shallow.ticks.energy.pump)[active],
        )
        meanings = file["status"].flag_meanings.split()
        assert meanings[int(file["status"][0])] == "completed"
        flight = shallow.metrics.flight
        assert file["flight_energy_pump"][0] == pytest.approx(float(flight.energy.pump))
        assert file["flight_moves_mass_angle"][0] == float(flight.moves.mass_angle)
        assert file["flight_energy_per_made_good"].units == "J m-1"
        rows = halves(shallow)
        assert len(file.dimensions["half"]) == len(rows)
        assert [HALVES[n] for n in file["half_kind"][0]] == [r["half"] for r in rows]
        for key, name, unit in (
            ("duration_s", "half_duration", "s"),
            ("depth_rate_m_s", "half_depth_rate", "m s-1"),
            ("hotel_energy_J", "half_hotel_energy", "J"),
            ("mass_angle_moves", "half_mass_angle_moves", "1"),
        ):
            assert file[name].units == unit
            np.testing.assert_allclose(file[name][0], [row[key] for row in rows])


def test_dives_of_a_record_with_ticks_left_out_are_those_of_the_whole(shallow):
    """One tick in five misses the shorter turns, not the halves that they part."""
    few = dataclasses.replace(
        shallow, ticks=jax.tree.map(lambda x: x[::5], shallow.ticks)
    )
    assert len(dive_spans(few)) == len(dive_spans(shallow)) == 5
    rows, wholes = halves(few), halves(shallow)
    # The last climb has no end where the tick at the surface is left out.
    assert len(rows) == len(wholes) - 1
    for row, whole in zip(rows, wholes[:-1], strict=True):
        assert row["half"] == whole["half"]
        assert row["start_s"] == pytest.approx(whole["start_s"], abs=20.0)


def test_halves_share_the_energy_and_the_way_of_the_flight(shallow):
    rows, flight = halves(shallow), shallow.metrics.flight
    for name, spent in vars(flight.energy).items():
        parts = [row[f"{name}_energy_J"] for row in rows]
        # The rest is spent at the surface, before the first dive and after the last.
        left = float(spent) - sum(parts)
        assert left == pytest.approx(0.0, abs=1e-6) or name not in ("steering", "hotel")
        assert left >= -1e-6
    for row in rows:
        parts = [row[f"{name}_energy_J"] for name in vars(flight.energy)]
        assert row["energy_J"] == pytest.approx(sum(parts))
        # The path is as steep as the pitch and the angle of attack together.
        steep = abs(row["depth_rate_m_s"]) * row["duration_s"] / row["made_good_m"]
        assert 20.0 < math.degrees(math.atan(steep)) < 30.0
    travel = sum(row["mass_angle_travel_rad"] for row in rows)
    assert travel == pytest.approx(float(flight.travel.mass_angle), rel=0.05)


@pytest.mark.parametrize("case", ["switching", "waypoints"])
def test_the_papers_cases_ship_on_actuators_that_have_a_speed(case):
    mission = load_mission(mission_path(f"paper-{case}"))
    scenario, own = mission.loop.scenario, paper.make_scenario(case, "seawing")
    assert float(scenario.actuators.mass_position.rate_limit) == 0.005
    leaves = [
        jax.tree.leaves(dataclasses.replace(one, energy=None))
        for one in (scenario, own)
    ]
    for a, b in zip(*leaves, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
    gains = tuned_gains(case, "seawing", "fxtppc")
    tuned = load_gains(gains, case, mission.model)
    assert mission.law.controller == tuned.controller


SHIPPED = ("slocum", "pid", "backstepping", "fixed-time-backstepping")


@pytest.mark.parametrize("law", SHIPPED)
def test_gains_shipped_for_a_mission_fly_it_upright_and_keep_the_heading(
    law, slocum, shallow
):
    """PID rolls over with those it begins with; the flown law is the one to beat."""
    assert tuned_gains("slocum-shallow", "seawing", law).is_file()
    mission = load_mission(mission_path("slocum-shallow"))
    case = FlightCase.of_mission(mission)
    (gains,) = case.resolve(["tuned"], [law])
    assert gains.label == f"{law} (tuned)"
    scenario = slocum.scenario
    loop = case.loop(gains)[1]
    key = jax.random.key(mission.seed)
    metrics = jax.jit(evaluate)(loop, scenario.sea(key), scenario.noise(key))
    assert int(metrics.status) == COMPLETED
    assert float(metrics.max_roll) < 0.1
    flown = float(shallow.metrics.flight.heading_error)
    assert float(metrics.flight.heading_error) < 0.85 * flown


def test_a_mission_file_can_ask_for_the_gains_that_come_along_for_it(tmp_path):
    """By its name; under another it is given those of the paper's case, here none."""
    data = tomllib.loads(mission_path("slocum-shallow").read_text(encoding="utf-8"))
    data["controller"] = {"type": "slocum", "gains_file": "tuned"}
    file = tmp_path / "mission.toml"
    file.write_text(tomli_w.dumps(data))
    mission = load_mission(file)
    path = tuned_gains("slocum-shallow", "seawing", "slocum")
    wanted = load_gains(path, "waypoints", mission.model).controller
    assert mission.law.controller == wanted
    data["name"] = "another\0name"
    file.write_text(tomli_w.dumps(data))
    with pytest.raises(ValueError, match="no gains come with jaxglider for slocum"):
        load_mission(file)


def test_each_dive_has_a_page_from_one_inflection_at_the_top_to_the_next(
    slocum, shallow, tmp_path
):
    spans, phase = dive_spans(shallow), np.asarray(shallow.ticks.phase)
    assert len(spans) == 5
    for before, after in itertools.pairwise(spans):
        assert before.stop == after.start
    for span in spans:
        assert phase[span.start] == INFLECTION
        assert phase[span.start - 1] in (SURFACE, CLIMB)
        assert set(phase[span]) == {INFLECTION, DIVE, APOGEE, CLIMB}
    assert phase[spans[-1].stop] == SURFACE
    few = jax.tree.map(lambda x: np.asarray(x)[: spans[1].stop + 1], shallow.ticks)
    run = dataclasses.replace(shallow, ticks=few)
    path = tmp_path / "dives.pdf"
    assert save_dives(path, run, slocum.scenario.actuators, "two") == 2
    assert len(re.findall(rb"/Type /Page\b", path.read_bytes())) == 2
    axes = new_figure(3.0, 9.0).subplots(PANELS, 1)
    dive(axes, shallow, slocum.scenario.actuators, spans[0], "one")
    named = {text.get_text() for text in axes[0].get_legend().get_texts()}
    assert named == {*PHASES, "wanted", "limit"} - {"surface"}


def test_the_figure_of_energy_ends_with_what_was_spent(shallow):
    axis = new_figure(3.0, 3.0).subplots()
    energy(axis, shallow)
    paths = [path for part in axis.collections for path in part.get_paths()]
    top = max(path.vertices[:, 1].max() for path in paths)
    assert top == pytest.approx(float(shallow.metrics.flight.total_energy) / 1e3)


def test_a_regulator_is_designed_for_the_control_period_of_its_mission(slocum):
    """For a period of 1 s, and run every 4 s, it rolls the glider over."""
    mission = load_mission(mission_path("slocum-shallow"))
    case = FlightCase.of_mission(mission)
    (gains,) = case.resolve(["paper"], ["lqr"])
    _, loop = case.loop(gains)
    assert float(loop.controller.period) == float(slocum.scenario.clock.dt) == 4.0
    run = flown(loop)
    assert status(run) == "completed"
    assert float(run.metrics.max_roll) < 0.2
