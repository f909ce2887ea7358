"""Running sums give what the definitions give on the whole trajectory."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
from test_physics import array

from jaxglider import GliderState, paper
from jaxglider.control.prescribed.funnel import Limits
from jaxglider.control.prescribed.performance import unbounded
from jaxglider.core.containers import as_float
from jaxglider.files.results import metrics_dict
from jaxglider.signals import Channels, Command, zeros
from jaxglider.simulation.checks.start import start_warnings
from jaxglider.simulation.metrics import add_tick, empty_sums, finish

DURATION = 20.0
COMMANDS = {
    "depth": "buoyancy_mass",
    "pitch": "mass_position",
    "heading": "mass_angle",
}


def hard_pressed(loop):
    """The same loop with a funnel that closes within the run, and weak actuators."""
    loop = eqx.tree_at(
        lambda x: (
            x.controller.funnel.performance.depth.settling_time,
            x.controller.funnel.performance.pitch.settling_time,
            x.controller.funnel.performance.heading.settling_time,
            x.controller.funnel.performance.heading.final_bound,
            x.scenario.actuators.buoyancy_mass.limit,
            x.scenario.actuators.mass_angle.limit,
        ),
        loop,
        tuple(map(as_float, (4.0, 5.0, 6.0, 0.05, 0.02, 0.01))),
    )
    specified = lambda x: x.scenario.specification.funnel
    return eqx.tree_at(specified, loop, loop.controller.funnel)


def short_path(loop):
    """Five waypoints, four near the start, so that the mission ends within the run."""
    north = jnp.array([1.0, 2.0, 3.0, 4.0, 5.3])
    return eqx.tree_at(
        lambda x: (x.scenario.reference.north, x.scenario.reference.east),
        loop,
        (north, jnp.array([3.0] * 5)),
    )


LOOPS = {
    "switching": lambda: paper.make_loop("switching", duration=DURATION),
    "switching, hard pressed": lambda: hard_pressed(
        paper.make_loop("switching", duration=DURATION)
    ),
    "waypoints": lambda: paper.make_loop("waypoints", duration=DURATION),
    "waypoints, ended": lambda: short_path(
        paper.make_loop("waypoints", duration=DURATION)
    ),
}


def crowding(nearness):
    """0 up to 0.8, 1/2 at the edge, 1 far beyond."""
    fourth = np.maximum(5.0 * nearness - 4.0, 0.0) ** 4
    return fourth / (1.0 + fourth)


def recomputed(loop, ticks):
    """All measures, from the definitions."""
    on = np.asarray(ticks.active)
    result = {}
    for channel, command in COMMANDS.items():
        e = np.asarray(getattr(ticks.error, channel))[on]
        u = np.asarray(getattr(ticks.applied, command))[on]
        wanted = np.asarray(getattr(ticks.wanted, command))[on]
        limit = float(getattr(loop.scenario.actuators, command).limit)
        function = getattr(loop.controller.funnel.performance, channel)
        d = np.maximum(np.abs(wanted) - limit, 0.0)
        settled = np.asarray(ticks.clock)[on] >= float(function.settling_time)
        p0, final, duration = map(
            float, (function.initial, function.final_bound, function.settling_time)
        )
        clock = np.minimum(np.asarray(ticks.clock)[on], duration * (1 - 1e-9))
        with np.errstate(over="ignore"):
            width = 1 / np.cosh(duration / (duration - clock) / np.cosh(p0)) + final
        result[channel] = {
            "max_error": np.abs(e).max(),
            "max_error_settled": np.abs(e[settled]).max() if settled.any() else np.nan,
            "rms_error": np.sqrt(np.mean(e**2)),
            "rms_effort": np.sqrt(np.mean(u**2)),
            "chattering": np.sqrt(np.sum(np.diff(u) ** 2) / len(u)),
            "travel": np.sum(np.abs(np.diff(u, prepend=0.0))),
            "time_outside_funnel": np.mean(np.abs(e) > width),
            "time_saturated": np.mean(np.abs(wanted) > limit),
            "funnel_peak": np.max(np.abs(e) / width),
            "funnel_crowding": np.mean(crowding(np.abs(e) / width)),
            "saturation_excess": np.mean(
                np.divide(d**2, u**2 + d**2, out=np.zeros_like(d), where=d > 0)
            ),
        }
    return result


@pytest.mark.parametrize("name", LOOPS)
def test_running_sums_equal_the_definitions(name, simulate_jit):
    loop = LOOPS[name]()
    run = simulate_jit(loop, loop.scenario.sea(jr.key(0)))
    ticks, metrics = run.ticks, run.metrics
    on = np.asarray(ticks.active)
    expected = recomputed(loop, ticks)
    for channel, values in expected.items():
        found = getattr(metrics.channels, channel)
        assert values.keys() == vars(found).keys()
        for field, value in values.items():
            # The smooth share is kept from dividing by zero with 1e-12.
            rtol = 1e-6 if field == "saturation_excess" else 1e-10
            np.testing.assert_allclose(
                getattr(found, field), value, rtol=rtol, atol=1e-15, err_msg=field
            )
    np.testing.assert_allclose(metrics.end_time, on.sum() * 0.05, rtol=1e-12)
    for field, angle in (("max_roll", "roll"), ("max_pitch", "pitch")):
        value = np.abs(np.asarray(getattr(ticks.state, angle))[on]).max()
        assert float(getattr(metrics, field)) == value
    ended = name == "waypoints, ended"
    assert bool(metrics.finite)
    assert not bool(metrics.capsized)
    assert bool(on.all()) != ended
    assert int(metrics.waypoints_reached) == (5 if ended else 0)
    if name == "switching, hard pressed":
        # Otherwise the comparison would say nothing about these.
        assert 0 < expected["heading"]["time_outside_funnel"] < 1
        assert 0 < expected["heading"]["time_saturated"] < 1
        assert expected["heading"]["funnel_crowding"] > 0
        assert expected["heading"]["saturation_excess"] > 0
        assert expected["pitch"]["max_error_settled"] > 0
        assert expected["pitch"]["max_error_settled"] < expected["pitch"]["max_error"]


def test_completed_segments_of_a_schedule_are_counted(simulate_jit):
    loop = eqx.tree_at(
        lambda x: x.scenario.reference.schedule.start,
        LOOPS["switching"](),
        jnp.array([0.0, 5.0, 10.0, 15.0]),
    )
    run = simulate_jit(loop, loop.scenario.sea(jr.key(0)))
    assert int(run.metrics.waypoints_reached) == 3
    assert np.asarray(run.ticks.target)[[0, 99, 100, 399]].tolist() == [0, 0, 1, 3]


def sums_of(roll, errors, commands):
    """Sums over given ticks, with a funnel of 1 below and 2 above."""

    def tick(sums, given):
        error, command, held = given
        clock = jnp.zeros(())
        bound = unbounded(clock)
        limits = Limits(clock - 1.0, clock + 2.0)
        commands = Command(command, command, command)
        return add_tick(
            sums,
            state=GliderState.at_rest(roll=roll),
            error=Channels(error, error, error),
            bounds=Channels(bound, bound, bound),
            limits=Channels(limits, limits, limits),
            wanted=commands,
            applied=commands,
            held=Command(held, held, held),
        ), None

    errors, commands = jnp.asarray(errors), jnp.asarray(commands)
    held = jnp.concatenate([jnp.zeros(1), commands[:-1]])
    first = empty_sums(jnp.zeros(()))
    return jax.lax.scan(tick, first, (errors, commands, held))[0]


def test_measures_of_a_run_of_three_ticks_by_hand():
    sums = sums_of(0.3, [3.0, -4.0, 1.5], [1.0, 2.0, 4.0])
    state = GliderState.at_rest()
    found = finish(sums, state, jnp.asarray(2, jnp.int32), jnp.asarray(0.5))
    depth = found.channels.depth
    assert float(depth.max_error) == 4.0
    # A funnel that never settled says nothing, and must not read as perfect.
    assert np.isnan(depth.max_error_settled)
    np.testing.assert_allclose(depth.rms_error, math.sqrt((9 + 16 + 2.25) / 3))
    np.testing.assert_allclose(depth.rms_effort, math.sqrt(21 / 3))
    # The first command is no change: nothing was held before it.
    np.testing.assert_allclose(depth.chattering, math.sqrt((1 + 4) / 3))
    np.testing.assert_allclose(depth.time_outside_funnel, 2 / 3)
    assert float(depth.time_saturated) == 0.0
    # Shares of the edge they near: 3/2, 4/1 and 1.5/2.
    np.testing.assert_allclose(
        depth.funnel_crowding, (3.5**4 / (1 + 3.5**4) + 16.0**4 / (1 + 16.0**4)) / 3
    )
    assert float(depth.saturation_excess) == 0.0
    assert float(found.end_time) == 1.5
    assert int(found.waypoints_reached) == 2
    np.testing.assert_allclose(found.max_roll, 0.3)


@pytest.mark.parametrize(("roll", "capsized"), [(1.57, False), (-1.58, True)])
def test_roll_past_a_right_angle_is_a_capsize(roll, capsized):
    sums = sums_of(roll, [0.0], [0.0])
    found = finish(
        sums, GliderState.at_rest(), jnp.asarray(0, jnp.int32), jnp.asarray(0.05)
    )
    assert bool(found.capsized) == capsized


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_number_that_is_not_finite_raises_a_flag_wherever_it_hides(bad):
    reached, dt = jnp.asarray(0, jnp.int32), jnp.asarray(0.05)
    good, rest = sums_of(0.0, [1.0], [0.5]), GliderState.at_rest()
    assert bool(finish(good, rest, reached, dt).finite)
    broken = eqx.tree_at(lambda s: s.yaw_rate, rest, jnp.asarray(bad))
    assert not bool(finish(good, broken, reached, dt).finite)
    spoilt = sums_of(0.0, [bad, 1.0], [0.5, 0.5])
    assert not bool(finish(spoilt, rest, reached, dt).finite)
    # A roll that is not a number is no upright glider either.
    assert bool(finish(sums_of(jnp.nan, [1.0], [0.5]), rest, reached, dt).capsized)


def test_sums_start_at_zero_in_the_precision_of_the_state():
    sums = empty_sums(jnp.zeros((), jnp.float32))
    for path, leaf in jax.tree_util.tree_leaves_with_path(sums):
        assert leaf.dtype == jnp.float32
        # Below zero until the funnel settles.
        unsettled = path[-1].name == "max_error_settled"
        assert float(leaf) == (-1.0 if unsettled else 0.0)
    assert array(zeros(Channels)).tolist() == [0.0] * 3
    assert {f.name for f in dataclasses.fields(sums)} >= {"ticks", "channels"}


def at_its_goal(duration=5.0):
    """A course whose one waypoint is within its radius at the start."""
    loop = paper.make_loop("waypoints", duration=duration)
    at = lambda x: (x.scenario.reference.north, x.scenario.reference.east)
    return eqx.tree_at(at, loop, (jnp.asarray([1.0]), jnp.asarray([2.0])))


def test_a_run_that_is_over_at_its_start_violates_nothing(simulate_jit):
    loop = at_its_goal()
    metrics = simulate_jit(loop, loop.scenario.sea(jr.key(0))).metrics
    assert float(metrics.end_time) == 0.0
    assert int(metrics.waypoints_reached) == 1
    assert bool(metrics.finite)
    assert not bool(metrics.capsized)
    for channel in vars(metrics.channels).values():
        values = dict(vars(channel))
        assert np.isnan(values.pop("max_error_settled"))
        assert set(map(float, values.values())) == {0.0}
    plain = metrics_dict(metrics, has_waypoints=True)
    assert {v for c in plain["channels"].values() for v in c.values()} == {None}
    (warning,) = start_warnings(loop)
    assert warning.startswith("nothing is flown")
