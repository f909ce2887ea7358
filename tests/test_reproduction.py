"""The paper's study comes out as an independent prototype of the same equations had it.

The figures are that prototype's: float64, 20 Hz, design model at 0.8 of the truth.
"""

import dataclasses
import functools

import jax
import numpy as np
import pytest
from jax import lax

from jaxglider import paper
from jaxglider.simulation.metrics import finish
from jaxglider.simulation.tick import TickInput

CHANNELS = ("depth", "pitch", "heading")
FIGURES = {
    # scenario, controller: L2[e], L2[U], chattering, end [s]
    ("switching", "fxtppc"): (
        (0.1094, 0.0675, 0.2111),
        (0.0457, 0.0191, 0.0528),
        (0.0010, 0.0001, 0.0036),
        800.0,
    ),
    ("switching", "ppc"): (
        (0.0145, 0.0745, 0.1396),
        (0.0454, 0.0194, 0.2441),
        (0.0027, 0.0017, 0.3468),
        800.0,
    ),
    ("switching", "smc"): (
        (0.0161, 0.0664, 0.1113),
        (0.0471, 0.0190, 0.1800),
        (0.0014, 0.0012, 0.1087),
        800.0,
    ),
    ("waypoints", "fxtppc"): (
        (0.1275, 0.0926, 0.0741),
        (0.0458, 0.0189, 0.0634),
        (0.0010, 0.0003, 0.0043),
        868.0,
    ),
    ("waypoints", "ppc"): ((0.0146, 0.0824, 0.0579), None, None, 867.0),
    ("waypoints", "smc"): ((0.0154, 0.0649, 0.0535), None, None, 864.0),
}


# All is held once the course is finished, so its horizon may be longer: with as many
# ticks at every rate one compiled program serves them all.
COURSE_TICKS = 120_000
CHUNK = 8000
"""Ticks of the schedule at 10 Hz; at 100 Hz it is ten times as many."""
IN_CHUNKS = [{"scenario": "switching", "plant": "rigid-body", "controller": "fxtppc"}]
"""Cases for which the program of the chunks, compiled for other rates, serves too."""


def _make_loop(scenario="switching", controller="fxtppc", dt=0.05, **options):
    duration = None
    if (scenario, controller) == ("waypoints", "fxtppc"):
        duration = COURSE_TICKS * dt
    loop = paper.make_loop(
        scenario,
        controller=controller,
        dt=dt,
        duration=duration,
        # As in the paper, on every plant.
        steering=paper.INVERSION,
        actuators="ideal",
        **options,
    )
    # The prototype judged each law by its own funnel.
    scenario = dataclasses.replace(loop.scenario, specification=None)
    return dataclasses.replace(loop, scenario=scenario)


@pytest.fixture(scope="module")
def metrics_of(evaluate_jit):
    """Metrics of a case of the paper; each is run once."""

    @functools.cache
    def run(**options):
        loop = _make_loop(**options)
        if options in IN_CHUNKS:
            metrics = _metrics_in_chunks(loop)
        else:
            metrics = evaluate_jit(loop, loop.scenario.sea(jax.random.key(0)))
        assert float(metrics.end_time) <= paper.DURATION[options["scenario"]] + 1e-6
        return metrics

    return run


@jax.jit
def _chunk(loop, carry, times, sea):
    start, end = (
        jax.tree.map(lambda x, part=part: x[part], sea)
        for part in (slice(None, -1), slice(1, None))
    )
    inputs = TickInput(loop.plan(times, end, None), start, None)
    return lax.scan(lambda c, x: (loop.tick(c, x)[0], None), carry, inputs)[0]


def _metrics_in_chunks(loop):
    """What `evaluate` gives, by a program that any number of chunks share."""
    sea, times = loop.scenario.sea(jax.random.key(0)), loop.scenario.clock.times()
    carry = loop.init()
    for n in range(0, loop.scenario.clock.ticks, CHUNK):
        part = jax.tree.map(lambda x, n=n: x[n : n + CHUNK + 1], sea)
        carry = _chunk(loop, carry, times[n : n + CHUNK], part)
    return finish(carry.sums, carry.state, carry.reached, loop.scenario.clock.dt)


def _column(metrics, name):
    return [float(getattr(getattr(metrics.channels, c), name)) for c in CHANNELS]


@pytest.mark.parametrize(("scenario", "controller"), FIGURES)
def test_printed_plant_gives_the_reference_figures(metrics_of, scenario, controller):
    errors, efforts, chattering, end = FIGURES[scenario, controller]
    m = metrics_of(scenario=scenario, controller=controller)
    tolerance = 0.02 if controller == "fxtppc" else 0.10
    rounding = 0.5e-4
    np.testing.assert_allclose(
        _column(m, "rms_error"), errors, rtol=tolerance, atol=rounding
    )
    if efforts is not None:
        np.testing.assert_allclose(
            _column(m, "rms_effort"), efforts, rtol=tolerance, atol=rounding
        )
        np.testing.assert_allclose(
            _column(m, "chattering"), chattering, rtol=tolerance, atol=rounding
        )
    assert float(m.end_time) == pytest.approx(end, abs=1.0)
    assert bool(m.finite)
    if scenario == "waypoints":
        assert int(m.waypoints_reached) == 5


def test_time_outside_the_funnel_is_the_reference_one(metrics_of):
    m = metrics_of(scenario="switching", controller="fxtppc")
    assert _column(m, "time_outside_funnel") == [0.0, 0.0, 0.0]
    m = metrics_of(scenario="switching", controller="ppc")
    np.testing.assert_allclose(
        _column(m, "time_outside_funnel"), [0.0, 0.0003, 0.0122], atol=1e-4
    )
    m = metrics_of(scenario="waypoints", controller="fxtppc")
    np.testing.assert_allclose(
        _column(m, "time_outside_funnel"), [0.0, 0.085, 0.0], atol=1e-3
    )


@pytest.mark.parametrize("scenario", ["switching", "waypoints"])
def test_on_rigid_body_only_the_proposed_law_stays_upright(metrics_of, scenario):
    rolls = {}
    for controller in paper.CONTROLLERS:
        m = metrics_of(scenario=scenario, plant="rigid-body", controller=controller)
        assert bool(m.finite)
        rolls[controller] = float(m.max_roll)
    assert rolls["fxtppc"] < 2.0
    assert rolls["smc"] > 4 * np.pi
    assert rolls["ppc"] > 4 * np.pi


def test_chunks_give_what_the_whole_gives(metrics_of):
    whole = metrics_of(scenario="switching", controller="fxtppc")
    parts = _metrics_in_chunks(_make_loop())
    for a, b in zip(jax.tree.leaves(parts), jax.tree.leaves(whole), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6)


# The observer's numerical damping depends on the tick: this cell misses by 2.5 %.
_MISSES = pytest.mark.xfail(strict=True, reason="depth is 17.5 % off, 15 % is asked")


@pytest.mark.parametrize(
    ("scenario", "plant", "dt"),
    [
        ("switching", "printed", 0.1),
        ("switching", "printed", 0.01),
        ("switching", "rigid-body", 0.1),
        ("switching", "rigid-body", 0.01),
        ("waypoints", "printed", 0.1),
        pytest.param("waypoints", "printed", 0.01, marks=_MISSES),
        ("waypoints", "rigid-body", 0.1),
        ("waypoints", "rigid-body", 0.01),
    ],
)
def test_the_proposed_law_holds_at_10_and_100_hertz(metrics_of, scenario, plant, dt):
    case = {"scenario": scenario, "plant": plant, "controller": "fxtppc"}
    expected = metrics_of(**case)
    if scenario == "waypoints":
        m = metrics_of(**case, dt=dt)
        assert float(m.end_time) < paper.DURATION[scenario]
    else:
        m = _metrics_in_chunks(_make_loop(**case, dt=dt))
    assert bool(m.finite)
    reference = _column(expected, "rms_error")
    np.testing.assert_allclose(_column(m, "rms_error"), reference, rtol=0.15)


def test_single_precision_agrees_with_double(evaluate_jit):
    loop = paper.make_loop()
    sea = loop.scenario.sea(jax.random.key(0))
    single = jax.tree.map(
        lambda x: x.astype("float32") if x.dtype == "float64" else x, (loop, sea)
    )
    double = _column(evaluate_jit(loop, sea), "rms_error")
    np.testing.assert_allclose(
        _column(evaluate_jit(*single), "rms_error"), double, rtol=2e-3
    )
