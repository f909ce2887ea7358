"""Reverse mode against central differences, for every float that can be tuned.

200 s of the closed loop in double precision, from the paper's gains. The differences
are taken in relative steps of several sizes, second and fourth order; each float may
pick its best one: a small sensitivity needs a large step, a large one a small step.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from jaxglider import map_members, paper
from jaxglider.rollout import evaluate

STEPS = (1e-3, 1e-4, 1e-5, 1e-6)
TOLERANCE = 1e-5
FLOOR = 1e-10
"""Below this, relative to the objective of about 5, differences are rounding."""


def _parts(loop):
    return (loop.controller, loop.observer, loop.scenario.plant, _guidance(loop))


def _guidance(loop):
    reference = loop.scenario.reference
    if hasattr(reference, "line_of_sight"):
        return (reference.line_of_sight, reference.north, reference.east)
    schedule = reference.schedule
    return (schedule.gliding_angle, schedule.heading, schedule.depth_rate)


def _names(parts):
    leaves = jax.tree_util.tree_leaves_with_path(parts)
    return [jax.tree_util.keystr(path) for path, x in leaves for _ in range(np.size(x))]


def _objective(loop, sea):
    start, rebuild = ravel_pytree(_parts(loop))

    def loss(flat):
        changed = eqx.tree_at(
            lambda at: jax.tree.leaves(_parts(at)), loop, jax.tree.leaves(rebuild(flat))
        )
        c = evaluate(changed, sea).channels
        return (
            c.depth.rms_error / 0.12
            + c.pitch.rms_error / 0.05
            + c.heading.rms_error / 0.2
        )

    return start, loss


@pytest.mark.parametrize(
    ("scenario", "plant"),
    [("switching", "printed"), ("switching", "rigid-body"), ("waypoints", "printed")],
)
def test_every_gain_and_parameter_agrees_with_central_differences(scenario, plant):
    loop = paper.make_loop(scenario, plant, duration=200.0)
    start, loss = _objective(loop, loop.scenario.sea(jax.random.key(0)))
    value, gradient = jax.jit(jax.value_and_grad(loss))(start)
    scale = np.where(np.asarray(start) != 0.0, np.abs(start), 1.0)
    batch = jax.jit(lambda points: map_members(loss, points))
    error = np.full(start.size, np.inf)
    for h in STEPS:
        shift = jnp.diag(jnp.asarray(h * scale))
        points = [start + shift, start - shift, start + 2 * shift, start - 2 * shift]
        plus, minus, plus2, minus2 = np.split(
            np.asarray(batch(jnp.concatenate(points))), 4
        )
        second = (plus - minus) / (2 * h)
        fourth = (8 * (plus - minus) - (plus2 - minus2)) / (12 * h)
        for difference in (second, fourth):
            error = np.minimum(error, np.abs(difference - np.asarray(gradient) * scale))
    allowed = TOLERANCE * np.abs(gradient) * scale + FLOOR * float(value)
    names = _names(_parts(loop))
    bad = [f"{names[i]}: {error[i]:.1e}" for i in np.flatnonzero(error > allowed)]
    assert not bad, bad
    assert np.count_nonzero(np.abs(gradient) * scale > 1e-6) > 60


@pytest.mark.parametrize("controller", ["smc", "ppc"])
def test_baselines_agree_with_a_directional_difference(controller):
    loop = paper.make_loop("switching", "printed", controller, duration=20.0)
    start, loss = _objective(loop, loop.scenario.sea(jax.random.key(0)))
    direction = jax.random.normal(jax.random.key(1), start.shape) * jnp.abs(start)
    along = jax.jit(jax.value_and_grad(lambda t: loss(start + t * direction)))
    slope = along(0.0)[1]
    errors = []
    for h in (1e-4, 1e-5, 1e-6):
        difference = (along(h)[0] - along(-h)[0]) / (2 * h)
        errors.append(abs(float(difference / slope) - 1.0))
    assert min(errors) < TOLERANCE


def test_gradient_is_exact_where_the_error_starts_at_zero_and_at_the_funnel_edge():
    """Depth starts at zero error; heading is put on the 95 % edge of its funnel."""
    loop = paper.make_loop("switching", "printed", duration=20.0)
    sea = loop.scenario.sea(jax.random.key(0))
    bounds = loop.controller.bounds(jnp.asarray(0.0))
    edge = 0.95 * float(bounds.heading.value)
    heading = float(loop.scenario.reference.schedule.heading[0]) - edge

    def loss(heading, k1):
        at = lambda x: (x.scenario.initial_state.heading, x.controller.gains.heading.k1)
        changed = eqx.tree_at(at, loop, (heading, k1))
        return evaluate(changed, sea).channels.heading.rms_error

    both = jax.jit(jax.value_and_grad(loss, (0, 1)))
    value = lambda heading, k1: both(heading, k1)[0]

    # On the edge itself the second derivative of the transformation jumps, so the
    # start is differentiated just inside of it and just outside.
    for start in (heading + 1e-4, heading - 1e-4):
        slopes = both(start, 1e-3)[1]
        h = 1e-6
        by_start = (value(start + h, 1e-3) - value(start - h, 1e-3)) / (2 * h)
        by_gain = (value(start, 1e-3 + 1e-8) - value(start, 1e-3 - 1e-8)) / 2e-8
        np.testing.assert_allclose(slopes[0], by_start, rtol=1e-5)
        np.testing.assert_allclose(slopes[1], by_gain, rtol=1e-5)
