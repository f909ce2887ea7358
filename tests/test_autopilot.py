"""On board: the same commands as in simulation, and no harm from bad inputs."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import paper
from jaxglider.export.plant import PlantState, drift, truth_of
from jaxglider.export.vectors import replay
from jaxglider.onboard.guard import BITS, STATUS, Guard, status_names
from jaxglider.onboard.of_loop import autopilot
from jaxglider.signals import BodyAxes, Command, GliderState, map_fields, zeros
from jaxglider.vehicle.actuators import Actuator

TICKS = 400
DT = 0.05
NONE = np.zeros(TICKS, bool)


@jax.jit
def ticks_of(pilot, times, rows, failing, unsound):
    """All ticks in one scan; flags say where law and reference give NaN."""

    def tick(state, given):
        time, measured, fails, doubtful = given
        planned = pilot.plan(state, time)
        planned = eqx.tree_at(
            lambda p: p.vertical.depth,
            planned,
            jnp.where(doubtful, jnp.nan, planned.vertical.depth),
        )
        gain = pilot.controller.gains.pitch.k1
        at_work = eqx.tree_at(
            lambda p: p.controller.gains.pitch.k1,
            pilot,
            jnp.where(fails, jnp.nan, gain),
        )
        after, command, word = at_work.step(state, time, measured, planned)
        return after, (after, command, word)

    given = times, rows, failing, unsound
    return jax.lax.scan(tick, pilot.init(), given)[1]


def run(pilot, times, rows, failing=NONE, unsound=NONE):
    """Commands, names of status bits and states, tick by tick."""
    states, command, words = ticks_of(
        pilot, jnp.asarray(times), rows, jnp.asarray(failing), jnp.asarray(unsound)
    )
    commands = np.stack([np.asarray(x) for x in jax.tree.leaves(command)], axis=1)
    return commands, [set(status_names(int(w))) for w in words], states


def at(states, n):
    return jax.tree.map(lambda x: x[n], states)


def spoilt(rows, value, ticks, *names):
    """The measurements with a value in some places at some ticks."""
    for name in names or vars(rows):
        column = np.array(getattr(rows, name))
        column[ticks] = value
        rows = eqx.tree_at(lambda s, n=name: getattr(s, n), rows, jnp.asarray(column))
    return rows


@pytest.fixture(scope="module")
def flight(simulate_jit):
    """A loop, the simulated commands, and what was measured when."""
    loop = paper.make_loop("waypoints", "printed", "fxtppc", duration=TICKS * DT)
    ticks = simulate_jit(loop, loop.scenario.sea(jax.random.key(0))).ticks
    applied = np.stack([np.asarray(x) for x in jax.tree.leaves(ticks.applied)], axis=1)
    return loop, applied, np.asarray(ticks.time), ticks.state


def test_commands_are_those_of_the_simulation(flight):
    loop, applied, times, rows = flight
    commands, said, _ = run(autopilot(loop), times, rows)
    np.testing.assert_allclose(commands, applied, rtol=0, atol=1e-12)
    assert np.ptp(applied[:, 0]) > 0.1
    assert said[0] >= {"state_reset"}
    assert all(s <= {"saturated"} for s in said[1:])
    full = np.abs(commands) >= [0.4, 0.06, np.pi / 2]
    assert [("saturated" in s) for s in said] == full.any(axis=1).tolist()


@pytest.mark.parametrize("gone", [("pitch",), ("north", "surge"), ()])
def test_a_gap_is_bridged_and_nothing_integrates_meanwhile(flight, gone):
    loop, _, times, rows = flight
    rows = spoilt(rows, np.nan, slice(100, 103), *gone)
    commands, said, states = run(autopilot(loop), times, rows)
    held = [n for n, s in enumerate(said) if "measurement_held" in s]
    assert held == [100, 101, 102]
    assert np.isfinite(commands).all()
    before, during = at(states, 99), at(states, 102)
    for part in ("controller", "observer"):
        assert eqx.tree_equal(getattr(before, part), getattr(during, part))
    assert said[103] <= {"saturated"}


@pytest.mark.parametrize("wild", [np.inf, -np.inf, 1e30, 25.0])
def test_absurd_numbers_count_as_missing(flight, wild):
    loop, _, times, rows = flight
    _, said, states = run(autopilot(loop), times, spoilt(rows, wild, 7, "surge"))
    assert "measurement_held" in said[7]
    assert states.measured.surge[7] == rows.surge[6]
    assert states.measured.sway[7] == rows.sway[7]


def test_a_long_silence_ends_in_the_safe_command_and_a_fresh_start(flight):
    loop, _, times, rows = flight
    pilot = autopilot(loop, Guard(patience=2.0, safe=Command(-0.1, 0.01, 0.2)))
    commands, said, states = run(pilot, times, spoilt(rows, np.nan, slice(50, 150)))
    lost = [n for n, s in enumerate(said) if "measurement_lost" in s]
    # 2 s are 40 ticks; the 41st without a measurement is the first too many.
    assert lost == list(range(90, 150))
    np.testing.assert_array_equal(commands[90:150], [[-0.1, 0.01, 0.2]] * 60)
    assert "state_reset" in said[150]
    assert not any("state_reset" in s for s in said[151:])
    observer = at(states.observer, 150)
    assert float(observer.disturbance.surge) == 0.0
    assert float(observer.velocity.surge) == float(rows.surge[150])


def test_before_the_first_measurement_the_command_is_safe(flight):
    loop, _, times, rows = flight
    rows = spoilt(rows, np.nan, slice(3), "roll")
    commands, said, states = run(autopilot(loop), times, rows)
    assert all({"measurement_lost", "measurement_held"} <= s for s in said[:3])
    assert (commands[:3] == 0.0).all()
    assert np.asarray(states.started[:6]).tolist() == [False] * 3 + [True] * 3
    assert "state_reset" in said[3]
    assert not said[5] & {"measurement_lost", "measurement_held"}


def _mission_times(flight, change):
    loop, _, times, rows = flight
    readings = np.array(times)
    change(readings)
    _, said, states = run(autopilot(loop), readings, rows)
    return np.asarray(states.time.now), said


@pytest.mark.parametrize(
    ("reading", "bit"),
    [
        (np.nan, "clock_invalid"),
        (np.inf, "clock_invalid"),
        (-3.0, "clock_invalid"),
        (1e30, "clock_invalid"),
        (0.45, "clock_stuck"),
        (0.2, "clock_backwards"),
        (70.0, "clock_disbelieved"),
    ],
)
def test_one_bad_reading_of_the_clock_is_bridged(flight, reading, bit):
    def change(readings):
        readings[10] = reading
        readings[9] = 0.45

    now, said = _mission_times(flight, change)
    np.testing.assert_allclose(now, np.arange(TICKS) * DT, atol=1e-12)
    assert bit in said[10]
    clock = {name for name in BITS if name.startswith("clock")}
    # A false leap forward makes the next reading look like one back.
    assert not any(s & clock for n, s in enumerate(said) if n not in (10, 11))


def test_a_stuck_clock_does_not_stop_the_mission(flight):
    def change(readings):
        readings[10:] = readings[10]

    now, said = _mission_times(flight, change)
    np.testing.assert_allclose(now, np.arange(TICKS) * DT, atol=1e-9)
    assert all("clock_stuck" in s for s in said[11:])


def test_mission_time_goes_on_where_it_was_if_the_clock_is_set_back(flight):
    def change(readings):
        readings[:30] += 100.0

    now, said = _mission_times(flight, change)
    np.testing.assert_allclose(np.diff(now), DT, atol=1e-9)
    assert "clock_backwards" in said[30]
    # 1 s of trust is 20 steady readings.
    assert "clock_disbelieved" in said[49]
    assert not any(s & {"clock_disbelieved", "clock_backwards"} for s in said[51:])


def test_mission_time_follows_a_clock_that_is_set_forward(flight):
    def change(readings):
        readings[30:] += 300.0

    now, said = _mission_times(flight, change)
    np.testing.assert_allclose(now[:45], np.arange(45) * DT, atol=1e-9)
    np.testing.assert_allclose(now[60:], np.arange(60, TICKS) * DT + 300.0)
    assert sum("ticks_missed" in s for s in said) == 1


def test_missed_ticks_are_said_and_believed(flight):
    def change(readings):
        readings[30:] += 1.0

    now, said = _mission_times(flight, change)
    assert now[30] == 31 * DT + 19 * DT
    assert [n for n, s in enumerate(said) if "ticks_missed" in s] == [30]


def test_a_law_that_fails_leaves_the_command_where_it_is(flight):
    loop, _, times, rows = flight
    failing = np.array(NONE)
    failing[20:30] = True
    commands, said, states = run(autopilot(loop), times, rows, failing)
    assert [n for n, s in enumerate(said) if "command_held" in s] == [*range(20, 30)]
    assert all("state_reset" in s for s in said[20:30])
    np.testing.assert_array_equal(commands[20:30], [commands[19]] * 10)
    assert np.isfinite(commands).all()
    assert np.isfinite(states.controller.integral.pitch).all()


def test_an_unsound_reference_is_replaced_by_the_last_one(flight):
    loop, _, times, rows = flight
    unsound = np.array(NONE)
    unsound[20] = True
    commands, said, states = run(autopilot(loop), times, rows, unsound=unsound)
    assert [n for n, s in enumerate(said) if "reference_held" in s] == [20]
    assert eqx.tree_equal(at(states.planned, 20), at(states.planned, 19))
    assert states.planned.vertical.depth[21] > states.planned.vertical.depth[20]
    assert np.isfinite(commands).all()


def test_at_the_last_waypoint_the_command_is_held(flight):
    loop, _, times, rows = flight
    wide = eqx.tree_at(lambda p: p.reference.radius, autopilot(loop), np.asarray(1e3))
    commands, said, _ = run(wide, times, rows)
    first = next(n for n, s in enumerate(said) if "finished" in s)
    # Five waypoints, one a tick.
    assert first == 4
    assert (commands[first:] == commands[first - 1]).all()


LONG = 4000


@jax.jit
def sail(loop, times, gap, shift):
    """Errors over the edge of the funnel in closed loop with spoilt measurements."""
    pilot, dt = autopilot(loop), loop.scenario.clock.dt
    truth = truth_of(loop)
    force = jax.tree.map(lambda x: 0.01 * jnp.ones_like(dt), zeros(BodyAxes, dt))

    def tick(carry, given):
        (state, afloat), (time, missing, added) = carry, given
        measured = jax.tree.map(
            lambda x: jnp.where(missing, jnp.nan, x + added), afloat.state
        )
        after, command, _ = pilot.step(state, time, measured, pilot.plan(state, time))
        following = drift(loop, truth, afloat, command, force)
        return (after, following), following.state

    start = PlantState(
        loop.scenario.initial_state, zeros(Command, dt), jnp.zeros_like(dt)
    )
    return jax.lax.scan(tick, (pilot.init(), start), (times, gap, shift))[1]


@pytest.mark.parametrize("fault", ["silence", "absurd", "clock"])
def test_a_glider_in_closed_loop_comes_back_to_its_course(fault):
    loop = paper.make_loop("switching", "printed", "fxtppc")
    times, hit = np.arange(LONG) * DT, slice(1000, 1020)
    gap, shift, readings = np.zeros(LONG, bool), np.zeros(LONG), np.array(times)
    # JAX may read these arrays later than it is called: never change what it was given.
    right = sail(loop, *(np.array(x) for x in (times, gap, shift)))
    if fault == "silence":
        gap[hit] = True
    elif fault == "absurd":
        shift[hit] = 1e7
    else:
        readings[hit] = times[999]
    wrong = sail(loop, readings, gap, shift)
    off = np.abs(
        [
            right.depth - wrong.depth,
            right.pitch - wrong.pitch,
            right.heading - wrong.heading,
        ]
    )
    assert off[:, :1000].max() == 0.0
    assert off[:, -1].max() < 0.01
    if fault == "clock":
        # Mission time goes on by itself: it is the same run to rounding.
        assert off.max() < 1e-6
    else:
        assert 1e-4 < off.max() < 0.5


def test_rates_are_limited_on_board_and_lags_are_left_to_the_servo(simulate_jit):
    actuators = Command(
        Actuator(0.4, rate_limit=0.02),
        Actuator(0.06, time_constant=1.0),
        Actuator(np.pi / 2),
    )
    loop = paper.make_loop("switching", "printed", "smc", duration=100 * DT)
    loop = eqx.tree_at(lambda c: c.scenario.actuators, loop, actuators)
    ticks = simulate_jit(loop, loop.scenario.sea(jax.random.key(0))).ticks
    pilot = autopilot(loop)
    seen = replay(pilot, ticks.time, ticks.state)
    np.testing.assert_allclose(
        seen.command.buoyancy_mass, ticks.applied.buoyancy_mass, rtol=0, atol=1e-12
    )
    asked = np.clip(np.asarray(ticks.wanted.mass_position), -0.06, 0.06)
    np.testing.assert_allclose(seen.command.mass_position, asked, rtol=0, atol=1e-12)
    assert np.ptp(asked) > 0.01
    steps = np.abs(np.diff(seen.command.buoyancy_mass))
    assert 0.0 < steps.max() <= 0.02 * DT + 1e-12


def test_bits_are_distinct_and_named():
    assert sorted(BITS.values()) == [1 << n for n in range(len(STATUS))]
    assert status_names(BITS["finished"] | BITS["clock_stuck"]) == [
        "clock_stuck",
        "finished",
    ]
    assert status_names(0) == []


def test_a_guard_refuses_what_is_not_positive():
    with pytest.raises(ValueError, match=r"Guard\.patience must be positive"):
        Guard(patience=0.0)
    ranges = Guard(speed=3.0).ranges()
    assert isinstance(ranges, GliderState)
    assert float(ranges.heave) == 3.0
    assert map_fields(lambda x: float(x) > 0, ranges).yaw_rate
