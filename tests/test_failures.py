"""A failed run says when it failed and why: people's mistakes, one by one."""

import dataclasses
import math
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider.files.mission import build_mission
from jaxglider.signals import Command
from jaxglider.simulation.checks import causes
from jaxglider.simulation.checks.failure import explain
from jaxglider.simulation.checks.past import Culprit, Past, before, first_nonsense
from jaxglider.simulation.flight import FlightMetrics
from jaxglider.simulation.rollout import Trajectory
from jaxglider.simulation.tick import TickRecord
from jaxglider.vehicle.energy import Consumers
from tuning.evaluation.failures import until_failure
from tuning.search.rescue import CannotStart

TICKS = 400


def loop_of(dt=0.05, current=0.0, start=None, angle=-30.0, **parameters):
    """A Slocum that is to turn round; what differs is traced, one program flies all."""
    return build_mission(
        {
            "vehicle": {
                "data": "slocum",
                "plant": "rigid-body",
                "parameters": parameters,
            },
            # The law without an observer compiles fastest.
            "controller": {"type": "smc"},
            "clock": {"dt_s": dt, "duration_s": dt * TICKS},
            "water": {"current": {"east_m_s": current}},
            "initial_state": start or {},
            "reference": {
                "schedule": {
                    "start_s": [0.0],
                    "gliding_angle_deg": [angle],
                    "heading_deg": [180.0],
                    "depth_rate_m_s": [0.2],
                }
            },
        }
    ).loop


@pytest.fixture(scope="module")
def fly(simulate_jit):
    def run(loop):
        return jax.device_get(simulate_jit(loop, loop.scenario.sea(jax.random.key(0))))

    return run


MISTAKES = {
    "tick": (dict(dt=5.0), "the integration step of 5 s is too long"),
    "current in cm/s": (dict(current=20.0), "the current of 20 m/s is more than any"),
    "start in cm/s": (
        dict(start={"surge_m_s": 5.0}),
        "the glider starts at 5 m/s through the water",
    ),
    "sign of a damping": (dict(roll_damping=2000.0), "the glider rolled over: past 90"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_the_first_line_names_the_cause(fly, mistake):
    values, said = MISTAKES[mistake]
    loop = loop_of(**values)
    run = fly(loop)
    failure = explain(loop, run)
    at = failure.culprit
    first, second, *_ = failure.lines()
    assert first.startswith(f"failed at {at.time:.6g} s: {said}")
    assert "Just before: depth" in second
    # Found by hand: the first record with a number beyond what gliders come to.
    wild = [
        ~(np.abs(np.asarray(getattr(run.ticks.state, name))) <= limit)
        for name, limit in (("surge", 30.0), ("roll_rate", 50.0), ("pitch_rate", 50.0))
    ]
    assert at.tick <= int(np.argmax(np.logical_or.reduce(wild)))
    kept = before(run, at.tick).ticks
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(kept.state))


def test_a_run_that_makes_sense_is_not_explained(fly):
    loop = loop_of()
    run = fly(loop)
    assert explain(loop, run) is None
    assert until_failure(loop, loop.scenario.sea(jax.random.key(0)), run) == (run, None)


def test_a_run_recorded_now_and_then_is_flown_again_tick_by_tick(fly):
    loop = loop_of(dt=5.0)
    sea = loop.scenario.sea(jax.random.key(0))
    whole = fly(loop)
    # What `keep_every=4` records; the short flight is cut from the long one here.
    sparse = dataclasses.replace(
        whole, ticks=jax.tree.map(lambda x: x[::4], whole.ticks)
    )
    flown = []

    def again(brief, part, noise):
        flown.append(brief.scenario.clock.ticks)
        assert jax.tree.leaves(part)[0].shape == (flown[-1] + 1,)
        return before(whole, flown[-1])

    run, failure = until_failure(loop, sea, sparse, 4, again)
    expected = first_nonsense(whole, 0.0)
    assert failure.culprit == expected
    assert flown[0] <= expected.tick + 5
    assert len(run.ticks.time) == expected.tick
    np.testing.assert_array_equal(
        run.ticks.state.depth, whole.ticks.state.depth[: expected.tick]
    )


def test_nonsense_of_the_last_tick_is_seen_in_the_way_made_good(fly):
    """A mission that is over has no record of where its last tick took the glider."""
    whole = fly(loop_of())
    end = float(whole.metrics.end_time)

    def made(good):
        zero = jnp.zeros(())
        energy = Consumers(*(zero,) * len(dataclasses.fields(Consumers)))
        names = [field.name for field in dataclasses.fields(FlightMetrics)]
        moved = dict.fromkeys(("moves", "travel"), Command(zero, zero, zero))
        parts = dict.fromkeys(names, zero) | moved | {"energy": energy}
        flight = FlightMetrics(**parts | {"made_good": jnp.asarray(good)})
        metrics = jax.tree.map(jnp.asarray, whole.metrics)
        metrics = dataclasses.replace(metrics, flight=flight)
        return dataclasses.replace(whole, metrics=metrics)

    assert first_nonsense(made(29.0 * end), end) is None
    found = first_nonsense(made(5e38), end)
    assert found == Culprit(TICKS, end, "way made good", 5e38)


def past(loop, run, tick, name="surge", value=math.nan):
    time = float(run.ticks.time[tick])
    return Past(loop, Culprit(tick, time, name, value), before(run, tick).ticks)


def test_a_start_at_rest_in_a_current_is_told_from_one_that_drifts_with_it(fly):
    still = loop_of(current=0.3)
    run = fly(still)
    said = causes.adrift_at_start(past(still, run, 100))
    assert "the water meets the glider at 0.3 m/s from port" in said
    drifting = loop_of(current=0.3, start={"sway_m_s": 0.3, "surge_m_s": 0.2})
    assert causes.adrift_at_start(past(drifting, run, 100)) is None


def test_a_stall_and_an_actuator_at_its_limit_are_told_by_how_long(fly):
    loop = loop_of()
    ticks = fly(loop).ticks
    limit = float(loop.scenario.actuators.mass_angle.limit)
    held = np.asarray(ticks.applied.mass_angle).copy()
    held[TICKS - 140 :] = -limit
    ticks = eqx.tree_at(
        lambda t: (t.state.heave, t.applied.mass_angle, t.wanted),
        ticks,
        (np.ones(TICKS), held, ticks.applied),
    )
    ticks = eqx.tree_at(lambda t: t.wanted.mass_angle, ticks, held)
    flight = Past(loop, Culprit(TICKS, 20.0, "surge", math.nan), ticks)
    assert "the glider was stalled: angle of attack" in causes.stalled(flight)
    said = causes.actuator_at_limit(flight).split("; ")
    assert "the mass angle stood at its limit of 1.571 rad for the last 7 s" in said


def test_a_law_that_gives_no_number_is_named_before_the_state(fly):
    loop = loop_of()
    run = fly(loop)
    wanted = np.asarray(run.ticks.wanted.mass_position).copy()
    wanted[7:] = np.nan
    run = eqx.tree_at(lambda r: r.ticks.wanted.mass_position, run, wanted)
    failure = explain(loop, run)
    assert (failure.culprit.tick, failure.culprit.name) == (7, "mass_position wanted")
    assert failure.cause().startswith("the law asked for a mass position of nan while")


def test_the_fastest_motion_of_a_glider_is_that_of_its_linear_model():
    """Against differences of the equations of motion at the same state."""
    loop = loop_of(start={"surge_m_s": 0.4})
    state = loop.scenario.initial_state
    none = Command(*(jnp.zeros(()),) * 3)
    (rate,) = causes.plant_rates(loop, [(state, none)])
    calm = jax.tree.map(jnp.zeros_like, loop.scenario.sea(jax.random.key(0)))
    calm = jax.tree.map(lambda x: x[0], calm)
    derivative = jax.jit(lambda *x: loop.scenario.plant.derivative(*x))
    names = causes.STATES
    columns = []
    for name in names:
        ends = [
            derivative(
                dataclasses.replace(state, **{name: getattr(state, name) + step}),
                none,
                calm,
            )
            for step in (1e-6, -1e-6)
        ]
        columns.append(
            [(getattr(ends[0], n) - getattr(ends[1], n)) / 2e-6 for n in names]
        )
    values = np.linalg.eigvals(np.array(columns).T)
    assert rate == pytest.approx(np.abs(values[values.real <= 0.0]).max(), rel=1e-5)


def test_a_tune_that_cannot_start_ends_with_code_1_and_what_it_tried(
    call, tmp_path, monkeypatch
):
    import tuning.cli.commands.tune as command

    def hopeless(*args, **kwargs):
        raise CannotStart("nothing to tune from: all is lost", [loop_of(), loop_of()])

    monkeypatch.setattr(command, "solve", hopeless)
    monkeypatch.setattr(command, "problem_spec", lambda options: None)
    code, out, err = call("tune", "--out", "o")
    assert (code, out) == (1, "")
    assert err.splitlines()[0] == "jaxglider: nothing to tune from: all is lost"
    assert "o: tried-1.toml to tried-2.toml." in err
    assert (tmp_path / "o" / "tried-2.toml").exists()


def test_a_mission_that_ends_in_the_tick_that_loses_the_glider_keeps_the_ticks_before():
    """The records after its end are of a glider that is lost: no cause is in them."""
    groups = ("state", "wanted", "applied", "error", "estimate")
    numbers = {g: SimpleNamespace(north=np.array([0.0, 1.0, np.nan])) for g in groups}
    active, time = np.array([True, True, False]), np.array([0.0, 4.0, 8.0])
    ticks, run = object.__new__(TickRecord), object.__new__(Trajectory)
    lost = SimpleNamespace(finite=False)
    parts = {"active": active, "time": time, **numbers}
    for one, fields in ((ticks, parts), (run, {"ticks": ticks, "metrics": lost})):
        for name, value in fields.items():
            object.__setattr__(one, name, value)
    culprit = first_nonsense(run, 12.0)
    assert (culprit.tick, culprit.time, culprit.name) == (2, 8.0, "state")
