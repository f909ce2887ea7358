"""Lists that a user writes may be long: programs do not grow with their number."""

import dataclasses
import re

import compiled_c
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_c import Onboard, columns

from jaxglider import AttitudeSchedule, Schedule, WaypointPath, paper
from jaxglider.environment.disturbances import Constant, GaussMarkov, Sinusoid, Sum
from jaxglider.export.autopilot import autopilot_source
from jaxglider.export.vectors import replay
from jaxglider.onboard.of_loop import autopilot
from jaxglider.signals import BodyAxes, GliderState, map_fields
from jaxglider.simulation.rollout import evaluate

FEW, MANY = 10, 200
MOST = 1.5
"""Equations for many over equations for few: 1 if the number plays no part."""
DRAW = np.random.default_rng(11)


def path(count):
    return WaypointPath(
        np.cumsum(DRAW.uniform(8.0, 20.0, count)),
        DRAW.uniform(-9.0, 9.0, count),
        paper.guidance(),
        paper.vertical_schedule(),
        radius=5.0,
        abeam=8.0,
    )


def schedule(count):
    return AttitudeSchedule(
        Schedule(
            100.0 * np.arange(count),
            DRAW.uniform(-1.0, -0.5, count),
            DRAW.uniform(-1.0, 1.0, count),
            DRAW.uniform(0.1, 0.2, count),
        )
    )


def six(low, high):
    return BodyAxes(*DRAW.uniform(low, high, 6))


def wave():
    return Sinusoid(six(0.1, 1.0), six(0.01, 0.1), six(-3.0, 3.0))


def noise():
    return GaussMarkov(six(0.1, 1.0), six(5.0, 50.0))


def changed(**changes):
    loop = paper.make_loop("switching", "printed", "smc", duration=20.0)
    scenario = dataclasses.replace(loop.scenario, **changes)
    return dataclasses.replace(loop, scenario=scenario)


def equations(jaxpr):
    """How many, those of inner programs included."""
    inner = (
        part
        for equation in jaxpr.eqns
        for value in equation.params.values()
        for part in (value if isinstance(value, list | tuple) else (value,))
    )
    bodies = (getattr(part, "jaxpr", part) for part in inner)
    return len(jaxpr.eqns) + sum(equations(b) for b in bodies if hasattr(b, "eqns"))


def size(**changes):
    loop = changed(**changes)
    trace = jax.make_jaxpr(lambda: evaluate(loop, loop.scenario.sea(jax.random.key(0))))
    return equations(trace().jaxpr)


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("reference", path),
        ("reference", schedule),
        ("disturbance", lambda n: Sum(tuple(wave() for _ in range(n)))),
        ("disturbance", lambda n: Sum(tuple(noise() for _ in range(n)))),
    ],
    ids=["waypoints", "segments", "waves", "noises"],
)
def test_a_run_is_one_program_however_long_the_list(field, make):
    assert size(**{field: make(MANY)}) <= MOST * size(**{field: make(FEW)})


def test_many_waves_and_noises_add_up_as_they_would_one_by_one():
    terms = tuple(make() for _ in range(5) for make in (wave, noise, wave))
    terms = (Constant(six(0.1, 1.0)), *terms)
    key, times = jax.random.key(4), 0.05 * jnp.arange(50)
    total = jax.jit(lambda: Sum(terms).realise(key, times))()

    def alone(term, number):
        return term.realise(jax.random.fold_in(key, number), times)

    one_by_one = [alone(term, number) for number, term in enumerate(terms)]
    expected = map_fields(lambda *x: np.sum(np.stack(x), axis=0), *one_by_one)
    for axis in vars(total):
        np.testing.assert_allclose(
            getattr(total, axis), getattr(expected, axis), rtol=1e-12, atol=1e-13
        )


def source(reference):
    return autopilot_source(autopilot(changed(reference=reference)), "test")


@pytest.mark.skipif(compiled_c.COMPILER is None, reason="no C compiler here")
def test_many_waypoints_are_a_table_in_c_and_are_all_flown_to(tmp_path):
    many = path(MANY)
    own = source(many)
    body = re.sub(r"\{[^}]*\},\n", "{},\n", own.source)
    few = re.sub(r"\{[^}]*\},\n", "{},\n", source(path(FEW)).source)
    assert abs(len(body) - len(few)) < 0.01 * len(few)
    # From waypoint to waypoint: every leg of the table is looked up.
    places = np.repeat(np.stack([many.north, many.east], axis=1), 2, axis=0)
    times = 0.05 * np.arange(len(places))
    rest = GliderState.at_rest(pitch=-0.6, surge=0.4)
    rows = jax.tree.map(lambda x: np.full(len(places), x), rest)
    measured = dataclasses.replace(rows, north=places[:, 0], east=places[:, 1])
    log = replay(autopilot(changed(reference=many)), times, measured)
    flown = Onboard(tmp_path, own).replay(times, measured)
    np.testing.assert_allclose(flown, columns(log), rtol=1e-10, atol=1e-11)
    assert log.segment[-1] == MANY - 1


def test_many_segments_grow_the_code_by_their_running_depth_alone():
    """A few lines each for the depth at which it begins, no choice among them."""
    lines = [source(schedule(n)).source.count("\n") for n in (FEW, MANY)]
    assert lines[1] - lines[0] < 12 * (MANY - FEW)
