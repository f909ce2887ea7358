"""Gradients through the phases of a yo, against differences: where they are exact.

480 s of the shallow Slocum's mission by a law without dead bands, once a second: the
surface, an inflection, a dive, the apogee, the first of the climb. All one program.
"""

import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider.files.flight.missions import mission_path
from jaxglider.files.mission import build_mission
from jaxglider.simulation.rollout import evaluate

NAMES = ("heading_gain", "pitch_gain", "climb_angle", "dive_ballast", "drag", "bottom")
DRAG, BOTTOM = 4, 5
NEAR, FAR = 1e-6, 0.05
"""Relative steps: for the one no phase comes a tick earlier, for the other some do."""
WAY, DIVE_TIME = 0, 3


def places(loop):
    """The numbers that are varied, in the order of their names."""
    law, scenario = loop.controller, loop.scenario
    plan = scenario.reference.settings
    return (
        *(law.heading_gain, law.pitch_gain),
        *(plan.climb.angle, plan.dive.buoyancy_mass),
        *(scenario.plant.parameters.drag, plan.bottom),
    )


@pytest.fixture(scope="module")
def slopes():
    """Slopes of four measures by each number: of JAX, and differences near and far.

    By the relative change of the number.
    """
    tables = tomllib.loads(mission_path("slocum-shallow").read_text())
    tables |= {"controller": {"type": "pid"}}
    tables["clock"] |= {"period_s": 1.0, "duration_s": 480.0}
    loop = build_mission(tables).loop
    sea = loop.scenario.sea(jax.random.key(0))
    values = jnp.stack([jnp.asarray(x, float) for x in places(loop)])

    def measures(factors):
        run = evaluate(eqx.tree_at(places, loop, tuple(values * factors)), sea)
        flight = run.flight
        whole = flight.through_water, flight.pitch_error, flight.heading_error
        return jnp.stack([*whole, flight.dive_time, flight.dives])

    one, count = np.ones(len(NAMES)), len(NAMES)
    each = np.eye(count)
    steps = [s * h * each for h in (NEAR, FAR) for s in (1.0, -1.0)]
    rows = np.concatenate([one + 0.0 * each, *(one + step for step in steps)])
    along = np.tile(each, (5, 1))
    run = jax.jit(jax.vmap(lambda row, by: jax.jvp(measures, (row,), (by,))))
    flown, found = (np.asarray(x) for x in run(rows, along))
    assert np.all(flown[:, -1] == 1.0), "every one of them has dived once"
    parts = flown[:, :-1].reshape(5, count, -1)
    near, far = (
        (parts[first] - parts[first + 1]) / (2.0 * step)
        for first, step in ((1, NEAR), (3, FAR))
    )
    return found[:count, :-1], near, far


def test_a_gradient_is_exact_for_the_phases_as_they_come(slopes):
    found, near, _ = slopes
    assert np.all(np.abs(found[:BOTTOM, WAY]) > 1e-4), "each of them acts"
    np.testing.assert_allclose(found, near, rtol=1e-5, atol=2e-7)


def test_a_gradient_knows_nothing_of_when_a_phase_comes(slopes):
    """A deeper bottom is reached later by its growth over the depth rate there."""
    found, near, far = slopes
    np.testing.assert_array_equal(found[BOTTOM], 0.0)
    np.testing.assert_array_equal(near[BOTTOM], 0.0)
    np.testing.assert_array_equal(found[:, DIVE_TIME], 0.0)
    # 40 m at 0.11 m/s, which is what is left of the depth rate there.
    assert far[BOTTOM, DIVE_TIME] == pytest.approx(40.0 / 0.11, rel=0.15)


def test_a_gradient_is_biased_where_what_is_varied_moves_the_apogee(slopes):
    """More drag makes the dive longer too, which JAX leaves out."""
    found, near, far = slopes
    assert far[DRAG, DIVE_TIME] > 50.0
    assert found[DRAG, WAY] == pytest.approx(near[DRAG, WAY], rel=1e-5)
    assert far[DRAG, WAY] / found[DRAG, WAY] == pytest.approx(1.2, abs=0.15)
