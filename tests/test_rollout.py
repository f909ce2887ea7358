"""The closed loop, tick by tick and as a whole."""

import dataclasses
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
from test_gradients import _remembering
from test_metrics import DURATION, LOOPS
from test_physics import MatrixGlider, array

from jaxglider import Clock, GaussMarkov, paper
from jaxglider.control.observer import NoObserver
from jaxglider.core.containers import as_float
from jaxglider.environment.water import Current, Stratification, Water
from jaxglider.signals import BodyAxes, GliderState
from jaxglider.simulation.rollout import evaluate, simulate, with_ticks


@pytest.fixture(scope="module")
def loops():
    return {name: build() for name, build in LOOPS.items()}


@pytest.fixture(scope="module")
def runs(loops, simulate_jit):
    """One trajectory of each loop."""
    return {
        name: simulate_jit(loop, loop.scenario.sea(jr.key(0)))
        for name, loop in loops.items()
    }


@pytest.fixture(scope="module")
def finer(loops, simulate_jit):
    """The waypoints with four integration steps per tick."""
    loop = loops["waypoints"]
    clock = dataclasses.replace(loop.scenario.clock, substeps=4)
    scenario = dataclasses.replace(loop.scenario, clock=clock)
    loop = dataclasses.replace(loop, scenario=scenario)
    return simulate_jit(loop, loop.scenario.sea(jr.key(0)))


def leaves(tree):
    return [np.asarray(x) for x in jax.tree.leaves(tree)]


def assert_equal(found, expected, **tolerance):
    for a, b in zip(leaves(found), leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, **tolerance)


@pytest.mark.parametrize("name", LOOPS)
def test_evaluate_gives_the_metrics_of_simulate(name, loops, runs, evaluate_jit):
    loop = loops[name]
    found = evaluate_jit(loop, loop.scenario.sea(jr.key(0)))
    assert_equal(found, runs[name].metrics, rtol=1e-9, atol=1e-13)


def test_between_samples_actuators_move_on_in_every_kind_of_run(
    evaluate_jit, simulate_jit
):
    """With a clock that samples once in many steps; held for a tick, they would not."""
    loop, metrics = _remembering(10), {}
    for moving in (True, False):
        clock = dataclasses.replace(Clock.sampled(10.0, 1.0, 0.25), moving=moving)
        scenario = dataclasses.replace(loop.scenario, clock=clock)
        slow = dataclasses.replace(loop, scenario=scenario)
        sea = scenario.sea(jr.key(0))
        metrics[moving] = simulate_jit(slow, sea).metrics
        assert with_ticks(slow, 3).scenario.clock.moving is moving
        if moving:
            assert_equal(evaluate_jit(slow, sea), metrics[True], rtol=1e-9, atol=1e-13)
    pitch = {m: float(of.channels.pitch.rms_error) for m, of in metrics.items()}
    assert abs(pitch[True] - pitch[False]) > 1e-4 * pitch[True]


def replay(loop, ticks, method, every):
    """Largest distance of each tick's end from an independent step."""
    glider = MatrixGlider(loop.scenario.plant.parameters, rigid_body=False)
    states, commands = array(ticks.state), array(ticks.applied)
    forces = array(ticks.disturbance)
    return max(
        np.abs(
            getattr(glider, method)(
                states[n], commands[n], forces[n], forces[n + 1], 0.05
            )
            - states[n + 1]
        ).max()
        for n in range(0, 399, every)
    )


def test_each_tick_is_one_classical_runge_kutta_step(loops, runs):
    for name in ("switching", "switching, hard pressed", "waypoints"):
        assert replay(loops[name], runs[name].ticks, "classical_step", 5) < 1e-12


def test_with_substeps_each_tick_is_the_exact_motion(loops, finer):
    assert replay(loops["waypoints"], finer.ticks, "integrate", 13) < 1e-8


def test_records_start_with_the_initial_state_and_the_clock(loops, runs):
    ticks = runs["waypoints"].ticks
    assert array(ticks.state)[0].tolist() == [0, 3, *[0] * 10]
    np.testing.assert_allclose(ticks.time, 0.05 * np.arange(400), rtol=1e-13)
    sea = array(loops["waypoints"].scenario.sea(jr.key(0)))
    np.testing.assert_array_equal(array(ticks.disturbance), sea[:-1])
    assert array(ticks.estimate)[0].tolist() == [0.0] * 6


def test_applied_command_is_the_wanted_one_within_its_limits(loops, runs):
    for name, run in runs.items():
        on = np.asarray(run.ticks.active)
        actuators = loops[name].scenario.actuators
        limits = np.array([float(a.limit) for a in vars(actuators).values()])
        wanted, applied = array(run.ticks.wanted)[on], array(run.ticks.applied)[on]
        np.testing.assert_allclose(
            applied, np.clip(wanted, -limits, limits), rtol=0, atol=1e-15
        )


def test_lumped_disturbance_is_what_the_design_model_leaves_unexplained(loops, runs):
    loop, ticks = loops["switching"], runs["switching"].ticks
    believed = loop.controller.model.parameters
    glider = MatrixGlider(believed, rigid_body=False)
    states, commands = array(ticks.state), array(ticks.applied)
    for n in (0, 100, 300):
        x = states[n]
        force = (glider.coriolis(x[6:]) + glider.damping(x[6:])) @ x[6:]
        force += glider.actuation(x[3], x[4], commands[n])
        change = glider.inertia @ (states[n + 1] - x)[6:] / 0.05
        np.testing.assert_allclose(
            array(ticks.lumped)[n], change - force, rtol=1e-8, atol=1e-10
        )


def test_after_the_last_waypoint_everything_is_held(runs):
    ticks, metrics = runs["waypoints, ended"].ticks, runs["waypoints, ended"].metrics
    active = np.asarray(ticks.active)
    end = int(active.argmin())
    assert 0 < end < 399
    assert active[:end].all()
    assert not active[end:].any()
    states = array(ticks.state)
    # One waypoint after the other was taken, the last one within its radius.
    assert np.asarray(ticks.target)[:5].tolist() == [1, 2, 3, 4, 4]
    distance = np.hypot(states[:, 0] - 5.3, states[:, 1] - 3.0)
    assert distance[end - 1] > 5.0 >= distance[end]
    assert np.abs(np.diff(states[:end], axis=0)).max() > 0.0
    np.testing.assert_array_equal(states[end:], states[[end]].repeat(400 - end, 0))
    estimates = array(ticks.estimate)[end:]
    np.testing.assert_array_equal(estimates, estimates[[0]].repeat(400 - end, 0))
    np.testing.assert_allclose(metrics.end_time, 0.05 * end, rtol=1e-12)
    assert int(metrics.waypoints_reached) == 5


@pytest.mark.parametrize("when", [0, 200])
def test_number_that_is_not_finite_is_flagged_and_not_raised(
    when, loops, evaluate_jit, simulate_jit
):
    loop = loops["switching"]
    sea = loop.scenario.sea(jr.key(0))
    sea = eqx.tree_at(lambda s: s.pitch, sea, sea.pitch.at[when].set(jnp.nan))
    metrics = evaluate_jit(loop, sea)
    assert not bool(metrics.finite)
    assert float(metrics.end_time) == DURATION
    ticks = simulate_jit(loop, sea).ticks
    states = array(ticks.state)
    first = max(when, 1)
    assert np.isfinite(states[:first]).all()
    assert np.isnan(states[first + 1 :, 10]).all()


def test_more_substeps_move_the_measures_little(runs, finer):
    for channel in ("depth", "pitch", "heading"):
        one = float(getattr(runs["waypoints"].metrics.channels, channel).rms_error)
        four = float(getattr(finer.metrics.channels, channel).rms_error)
        assert 0 < abs(one - four) < 1e-4


@pytest.fixture(scope="module")
def noisy(loops):
    scenario = dataclasses.replace(
        loops["switching"].scenario,
        disturbance=GaussMarkov(BodyAxes(*(0.02,) * 6), BodyAxes(*(5.0,) * 6)),
    )
    return dataclasses.replace(loops["switching"], scenario=scenario)


@pytest.fixture(scope="module")
def seas(noisy):
    """Three realisations of noise, drawn one by one."""
    return [noisy.scenario.sea(jr.key(n)) for n in range(3)]


def test_same_key_gives_the_same_result_and_another_key_another(
    noisy, loops, seas, evaluate_jit
):
    loop = loops["switching"]
    first = evaluate_jit(loop, seas[0])
    again = evaluate_jit(loop, noisy.scenario.sea(jr.key(0)))
    for a, b in zip(leaves(first), leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
    other = evaluate_jit(loop, seas[1])
    assert float(other.channels.pitch.rms_error) != float(
        first.channels.pitch.rms_error
    )


def members_of(loop):
    """The loop three times, with other gains, parameters and starts."""

    def member(n):
        return eqx.tree_at(
            lambda x: (
                x.controller.gains.pitch.k1,
                x.scenario.plant.parameters.drag,
                x.scenario.initial_state.roll,
            ),
            loop,
            (
                loop.controller.gains.pitch.k1 * (1 + 0.5 * n),
                loop.scenario.plant.parameters.drag * (1 - 0.1 * n),
                as_float(0.05 * n),
            ),
        )

    return [member(n) for n in range(3)]


def test_lanes_of_a_batch_equal_single_runs(loops, seas, evaluate_jit):
    members = members_of(loops["switching"])
    stacked = jax.tree.map(
        lambda *x: jnp.stack(x), *[(m, s) for m, s in zip(members, seas, strict=True)]
    )
    lanes = jax.jit(jax.vmap(evaluate))(*stacked)
    results = [evaluate_jit(m, s) for m, s in zip(members, seas, strict=True)]
    efforts = {float(r.channels.pitch.rms_effort) for r in results}
    assert len(efforts) == 3
    for n, single in enumerate(results):
        lane = jax.tree.map(lambda x, n=n: x[n], lanes)
        assert_equal(lane, single, rtol=1e-9, atol=1e-9)


def test_new_numbers_need_no_new_trace(loops):
    traces = []

    def counted(loop, sea):
        traces.append(None)
        return loop.init(), loop.inputs(sea), evaluate(loop, sea)

    # Tracing is all that is counted: nothing is compiled or run.
    trace = jax.jit(counted).eval_shape
    other = LOOPS["switching, hard pressed"]()
    shapes = [
        trace(loop, loop.scenario.sea(jr.key(n)))
        for n, loop in enumerate([*members_of(loops["switching"]), other])
    ]
    slower = dataclasses.replace(
        loops["switching"].scenario,
        clock=Clock(400, dt=0.1),
        initial_state=GliderState.at_rest(depth=2, surge=0.1),
    )
    slower = dataclasses.replace(loops["switching"], scenario=slower)
    shapes.append(trace(slower, slower.scenario.sea(jr.key(9))))
    assert len(traces) == 1
    assert all(s == shapes[0] for s in shapes)


@pytest.mark.parametrize(
    ("scenario", "controller"),
    [("switching", "smc"), ("waypoints", "ppc"), ("waypoints", "fxtppc")],
)
def test_single_precision_stays_single_from_end_to_end(scenario, controller):
    loop = paper.make_loop(scenario, controller=controller, duration=1.0)
    sea = loop.scenario.sea(jr.key(0))
    small = jax.tree.map(
        lambda x: x.astype(jnp.float32) if eqx.is_inexact_array(x) else x, (loop, sea)
    )
    shapes = jax.eval_shape(simulate, *small)
    found = {
        leaf.dtype
        for leaf in jax.tree.leaves(shapes)
        if jnp.issubdtype(leaf.dtype, jnp.floating)
    }
    assert found == {jnp.dtype(jnp.float32)}
    realised = jax.eval_shape(small[0].scenario.sea, jr.key(0))
    assert all(x.dtype == jnp.float32 for x in jax.tree.leaves(realised))


def test_records_of_all_controllers_have_one_type():
    kinds = []
    for controller in ("smc", "ppc", "fxtppc"):
        loop = paper.make_loop("switching", controller=controller, duration=1.0)
        kinds.append(jax.eval_shape(simulate, loop, loop.scenario.sea(jr.key(0))))
    assert jax.tree.structure(kinds[0]) == jax.tree.structure(kinds[2])
    assert kinds[0] == kinds[1] == kinds[2]


def test_every_physical_term_is_named_in_the_compiler_s_input():
    loop = paper.make_loop("waypoints", duration=1.0)
    water = Water(Current(north=0.1), Stratification(50.0, density_gradient=1e-6))
    scenario = dataclasses.replace(loop.scenario, water=water)
    loop = dataclasses.replace(loop, scenario=scenario)
    lowered = jax.jit(evaluate).lower(loop, scenario.sea(jax.random.key(0)))
    text = lowered.compiler_ir("hlo").as_hlo_module().to_string()
    paths = re.findall(r'op_name="([^"]*)"', text)
    scopes = {scope for path in paths for scope in path.split("/")}
    assert scopes >= {
        "measurement",
        "guidance",
        "controller",
        "performance_functions",
        "error_transformation",
        "sliding_surface",
        "drift",
        "input_gain",
        "allocation",
        "actuators",
        "integration",
        "stratification",
        "current",
        "coriolis",
        "hydrodynamics",
        "actuator_wrench",
        "restoring_moment",
        "kinematics",
        "observer",
        "observer_root",
        "judgement",
        "metrics",
    }


class Listening(NoObserver):
    """Its estimate is what it was told last: command, true speed and depth, tick."""

    def step(self, observer_state, measurement, applied, following, dt):
        told = (*vars(applied).values(), measurement.state.surge, following.depth, dt)
        return BodyAxes(*told)


def test_the_observer_is_told_the_command_held_in_the_tick_and_the_state_after_it():
    loop = paper.make_loop("switching", controller="smc", duration=1.0)
    weak = jax.tree.map(lambda limit: 0.01 * limit, loop.scenario.actuators)
    scenario = dataclasses.replace(loop.scenario, actuators=weak)
    loop = dataclasses.replace(loop, scenario=scenario, observer=Listening())
    given = jax.tree.map(lambda x: x[3], loop.inputs(loop.scenario.sea(jr.key(0))))
    before = loop.init()
    after, record = loop.tick(before, given)
    assert not np.allclose(leaves(record.applied), leaves(record.wanted))
    applied = vars(record.applied).values()
    wanted = (*applied, before.state.surge, after.state.depth, scenario.clock.dt)
    np.testing.assert_array_equal(leaves(after.observer), leaves(wanted))
