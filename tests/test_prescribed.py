"""Prescribed means prescribed: whatever the free numbers are, P(t) <= P_spec(t)."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from jaxglider import Channels, Funnel, Specification, paper
from jaxglider.control.fxtppc import reaching_law, tian_exponents
from jaxglider.control.prescribed.performance import (
    ExponentialFunction,
    HalfSechFunction,
    SechFunction,
)
from jaxglider.control.prescribed.transform import ErrorTransformation
from jaxglider.simulation.checks.start import restart_jumps
from jaxglider.simulation.specification import (
    bounds_of_a_funnel_inside,
    falling_part,
    initial_of,
)
from tuning.space.error_settling import error_bound
from tuning.space.prescribed import EQUAL_EDGES, INSIDE, RESTART
from tuning.space.space import HELD_BY_DEFAULT, Space

FORMS = (SechFunction, HalfSechFunction, ExponentialFunction)
SPECIFIED = {
    SechFunction: SechFunction(0.9, 0.2, 90.0),
    HalfSechFunction: HalfSechFunction(0.4, 0.3, 90.0),
    ExponentialFunction: ExponentialFunction(1.6, 0.2, 90.0),
}
GRID = jnp.linspace(0.0, 120.0, 2401)


@pytest.fixture(scope="module")
def loop():
    return paper.make_loop("switching", "rigid-body", "fxtppc-roll", duration=700.0)


def steered_by(loop, form):
    """The loop with performance functions of one form, outside what is specified."""
    start = {SechFunction: 1.2, HalfSechFunction: 0.1, ExponentialFunction: 4.0}[form]
    return eqx.tree_at(
        lambda at: list(vars(at.controller.law.funnel.performance).values()),
        loop,
        [form(start, 0.5, 345.0)] * 3,
    )


def specified(loop, form):
    """The loop with a specification of one form, whose edges are not symmetric."""
    wide = 3.0 if form is ExponentialFunction else 1.0
    performance = SPECIFIED[form]
    if form is ExponentialFunction:
        performance = dataclasses.replace(performance, initial=wide)
    edges = ErrorTransformation(0.9, 0.8)
    funnel = Funnel(Channels(*(performance,) * 3), Channels(*(edges,) * 3))
    scenario = dataclasses.replace(loop.scenario, specification=Specification(funnel))
    return dataclasses.replace(loop, scenario=scenario)


PAIRS = [
    (SechFunction, SechFunction),
    (HalfSechFunction, HalfSechFunction),
    (ExponentialFunction, ExponentialFunction),
    (HalfSechFunction, SechFunction),
    (SechFunction, ExponentialFunction),
    (HalfSechFunction, ExponentialFunction),
]


@pytest.fixture(scope="module", params=PAIRS, ids=lambda p: p[0].__name__)
def written(request, loop):
    """A space inside a specification, and the funnel that it writes on a grid."""
    form, of_spec = request.param
    start = specified(steered_by(loop, form), of_spec)
    space = Space.of(start, ["controller"], HELD_BY_DEFAULT)
    assert not any("no " + form.__name__ in note for note in space.notes)
    judge = start.scenario.specification

    def edges(free):
        law = space.write(start, free).controller.law
        mine = jax.vmap(lambda t: law.funnel.limits(law.funnel.bounds(t)))(GRID)
        gains = vars(law.gains).values()
        return mine, jnp.stack([g.settling_bound() for g in gains]), law

    limits = jax.vmap(lambda t: judge.limits(judge.bounds(t)))(GRID)
    return space, start, jax.jit(edges), jax.device_get(limits)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([0.1, 1.0, 10.0, 1e6]))
def test_whatever_the_free_numbers_are_the_funnel_is_inside(written, seed, scale):
    space, start, edges, limits = written
    free = scale * np.random.default_rng(seed).standard_normal(len(space.names))
    mine, settling, law = jax.device_get(edges(jnp.asarray(free)))
    required = start.scenario.specification.required_settling()
    for channel, time in zip(vars(limits), settling, strict=True):
        inner, outer = getattr(mine, channel), getattr(limits, channel)
        assert np.all(inner.upper <= outer.upper)
        assert np.all(inner.lower >= outer.lower)
        assert np.all(inner.upper > 0.0)
        assert np.all(inner.lower < 0.0)
        assert time <= float(getattr(required, channel)) * (1 + 1e-9)
        gains = getattr(law.gains, channel)
        assert gains.k1 < 0.75 * gains.k2**2


def test_the_rules_of_what_is_written_hold(written):
    space, start, _, _ = written
    for scale in (1.0, 1e6):
        free = scale * np.random.default_rng(5).standard_normal(len(space.names))
        assert space.bounds_hold(space.write(start, jnp.asarray(free))) == []


def test_a_form_that_starts_too_high_is_named_and_left_alone(loop):
    start = specified(steered_by(loop, SechFunction), HalfSechFunction)
    space = Space.of(start, ["controller"], HELD_BY_DEFAULT)
    assert any("no SechFunction of depth" in note for note in space.notes)


@pytest.mark.parametrize("form", FORMS)
def test_the_corner_of_a_box_is_the_farthest_that_fits(form):
    """A little beyond any end of its own form, and the funnel sticks out."""
    box = bounds_of_a_funnel_inside(form, SPECIFIED[form])
    wide = box.initial.low if form is HalfSechFunction else box.initial.high
    corner = np.array([wide, box.final_bound, box.settling_time])
    on_grid = lambda performance: np.asarray(jax.vmap(performance)(GRID).value)
    outer = on_grid(SPECIFIED[form])
    assert np.all(on_grid(form(*corner)) <= outer)
    for at in range(3):
        beyond = corner.copy()
        beyond[at] *= 0.99 if (at, form) == (0, HalfSechFunction) else 1.01
        assert np.any(on_grid(form(*beyond)) > outer)


@pytest.mark.parametrize("form", FORMS)
def test_the_start_of_a_form_is_inverted(form):
    initial = jnp.linspace(1.0, 2.0, 7)
    performance = jax.vmap(lambda p: form(p, 0.05, 10.0)(jnp.asarray(0.0)).value)
    falling = jax.vmap(lambda p: falling_part(form, p))(initial)
    np.testing.assert_allclose(performance(initial) - 0.05, falling, rtol=1e-12)
    again = jax.vmap(lambda f: initial_of(form, f))(falling)
    np.testing.assert_allclose(again, initial, rtol=1e-9)
    slope = jax.vmap(jax.grad(lambda f: initial_of(form, f)))(
        jnp.asarray([-1.0, 0.2, 0.5, 0.648, 0.7, 1.0, 2.0])
    )
    assert np.all(np.isfinite(slope))


def test_a_funnel_starts_above_the_jump_of_the_reference(loop):
    space = Space.of(loop, ["controller"], HELD_BY_DEFAULT)
    jumps = restart_jumps(loop.scenario)
    # From rest to -45 degrees; and from -30 to 18 degrees at 600 s.
    assert jumps.pitch == pytest.approx(np.pi / 4)
    assert jumps.heading == pytest.approx(np.radians(48.0))
    rng = np.random.default_rng(3)
    for scale in (1.0, 30.0, 1e3):
        free = jnp.asarray(scale * rng.standard_normal(len(space.names)))
        funnel = space.write(loop, free).controller.law.funnel
        for channel in ("pitch", "heading"):
            width = getattr(funnel.performance, channel)(jnp.asarray(0.0)).value
            edges = getattr(funnel.transformation, channel)
            reach = min(float(edges.lower), float(edges.upper)) * float(width)
            assert reach >= getattr(jumps, channel) * (1.0 - 1e-6)


def test_a_specification_too_narrow_for_its_task_is_named(loop):
    at = lambda x: x.scenario.reference.schedule.heading
    turning = eqx.tree_at(at, loop, jnp.radians(jnp.asarray([0.0, 90.0, 0.0, 0.0])))
    notes = Space.of(turning, ["controller"], HELD_BY_DEFAULT).notes
    assert any(RESTART in note and "1.57" in note for note in notes)


def test_a_shorter_run_has_fewer_restarts(loop):
    short = paper.make_loop("switching", "rigid-body", "smc", duration=100.0)
    assert restart_jumps(short.scenario).heading == pytest.approx(np.pi / 6)


def test_each_constraint_is_let_go_by_name(loop):
    start = steered_by(loop, SechFunction)
    held = tuple(name for name in HELD_BY_DEFAULT if name != INSIDE)
    space = Space.of(start, ["controller"], held)
    law = space.write(start, space.read(start)).controller.law
    assert float(law.funnel.performance.depth.settling_time) == pytest.approx(345.0)
    inside = Space.of(start, ["controller"], HELD_BY_DEFAULT)
    law = inside.write(start, inside.read(start)).controller.law
    assert float(law.funnel.performance.depth.settling_time) < 100.0


def test_what_is_not_tuned_and_outside_is_named(loop):
    start = steered_by(loop, SechFunction)
    path = "controller.law.funnel.performance.depth"
    notes = Space.of(start, [f"{path}.initial"], HELD_BY_DEFAULT).notes
    assert any(f"{path}.settling_time = 345 is outside" in note for note in notes)


@pytest.mark.parametrize("free", [["k1"], ["mu"], ["mu", "k1"], ["k2"]])
def test_the_surface_settles_in_time_with_any_of_its_gains_tuned(loop, free):
    roomy = eqx.tree_at(
        lambda at: [at.controller.law.gains.depth.k1, at.controller.law.gains.depth.k2],
        loop,
        [jnp.asarray(0.01), jnp.asarray(0.13)],
    )
    paths = [f"controller.law.gains.depth.{name}" for name in free]
    space = Space.of(roomy, paths, HELD_BY_DEFAULT)
    rng = np.random.default_rng(1)
    for scale in (0.0, 1.0, 30.0, 1e4):
        numbers = jnp.asarray(scale * rng.standard_normal(len(paths)))
        gains = space.write(roomy, numbers).controller.law.gains.depth
        assert float(gains.settling_bound()) <= 100.0 * (1 + 1e-9)
        assert float(gains.k1) < 0.75 * float(gains.k2) ** 2
        assert float(gains.mu) > 1.0


def test_port_and_starboard_alike_is_one_number(loop):
    space = Space.of(loop, ["controller"], (*HELD_BY_DEFAULT, EQUAL_EDGES))
    assert not any(name.endswith(".upper") for name in space.names)
    free = jnp.asarray(np.random.default_rng(0).standard_normal(len(space.names)))
    law = space.write(loop, free).controller.law
    for edges in vars(law.funnel.transformation).values():
        assert float(edges.lower) == float(edges.upper) != 1.0


def test_the_smoothed_reaching_law_gets_to_its_width_within_the_bound():
    """The smoothing stops s at about its width, not before the bound."""
    smoothing, mu, gain, dt = 1e-3, 2.0, 0.5, 2e-4
    bound = 1.2091995761561452 * mu / gain

    @jax.jit
    def at_the_bound(s):
        width, power = jnp.asarray(smoothing), jnp.asarray(mu)
        step = lambda _, x: x - dt * gain * reaching_law(x, power, width)
        return jax.lax.fori_loop(0, int(bound / dt), step, s)

    for start in (1e-2, 1.0, 1e3):
        assert abs(float(at_the_bound(jnp.asarray(start)))) < smoothing


def at_rest_after(k1, k2, rho, start):
    """When ε of Tian's law on s = 0 is within 1e-9 of zero, by another integrator."""
    over = 4.0 - 3.0 * rho
    first, second = (rho / (2 - rho), over / (2 - rho)), (rho, over / (3 - 2 * rho))
    power = lambda x, p: np.sign(x) * abs(x) ** p

    def slope(_, y):
        x, v = y
        stiffness = power(x, first[0]) + x + power(x, first[1])
        friction = power(v, second[0]) + v + power(v, second[1])
        return [v, -k1 * stiffness - k2 * friction]

    arrived = lambda _, y: max(abs(y[0]), abs(y[1])) - 1e-4
    arrived.terminal = True
    found = solve_ivp(
        slope, (0, 1e5), start, "LSODA", events=arrived, rtol=1e-6, atol=1e-9
    )
    return found.t_events[0][0]


@pytest.mark.parametrize(("k2", "share"), [(0.3, 0.2), (0.3, 0.7), (3.0, 0.5)])
def test_the_bound_on_the_error_is_above_what_simulation_takes(k2, share):
    k1, rho = share * k2 * k2, 0.8
    bound = error_bound(k1, k2, rho)
    for start in ((1e6, 0.0), (1.0, 0.0), (1e3, 1e3), (-1e2, 1e4)):
        assert at_rest_after(k1, k2, rho, start) < bound
    # Found by a study on its own, with another integrator of all its parts.
    if (k2, share) == (0.3, 0.2):
        assert bound == pytest.approx(295.7 + 24.28, rel=2e-3)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([0.3, 3.0, 30.0, 1e6]))
def test_with_tians_pairing_the_error_settles_in_time_too(tian, seed, scale):
    space, _, write = tian
    free = scale * np.random.default_rng(seed).standard_normal(len(space.names))
    gains = jax.device_get(write(jnp.asarray(free)))
    for channel, time in (("depth", 100.0), ("pitch", 80.0), ("heading", 100.0)):
        of = getattr(gains, channel)
        assert error_bound(float(of.k1), float(of.k2), float(of.rho)) <= time
        surface = 1.2091995761561452 * float(of.mu) / float(of.k1 + of.k2)
        assert surface <= time * (1 + 1e-9)
        assert of.k1 < 0.75 * of.k2**2


@pytest.fixture(scope="module")
def tian(loop):
    law = dataclasses.replace(loop.controller.law, exponents=tian_exponents)
    controller = dataclasses.replace(loop.controller, law=law)
    start = dataclasses.replace(loop, controller=controller)
    space = Space.of(start, ["controller.law.gains"], HELD_BY_DEFAULT)
    assert space.bounds_hold(space.write(start, space.read(start))) == []
    write = jax.jit(lambda free: space.write(start, free).controller.law.gains)
    return space, start, write
