"""The laws of the textbooks, against second implementations and their theory."""

import math

import compiled_c
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import solve_ivp

from jaxglider import paper
from jaxglider.control.textbook.adrc import ADRCState, observer_gains
from jaxglider.control.textbook.fixed_time import Reaching
from jaxglider.control.textbook.linear_design import STATES, linear_model, trim_of
from jaxglider.core.riccati import regulator_gain, sampled
from jaxglider.export.autopilot import autopilot_source
from jaxglider.export.vectors import fly, sea
from jaxglider.onboard.of_loop import autopilot
from jaxglider.signals import BodyAxes, Command, GliderState, Measurement, zeros
from jaxglider.vehicle.plant import rigid_body_plant
from jaxglider.vehicle.published import load_vehicle

MODEL = paper.design_model(rigid_body_plant(load_vehicle("seawing").parameters))


def made(name):
    return paper.make_controller(name, "switching", MODEL)


@pytest.fixture(scope="module")
def glide():
    """A, B of the design model about a dive."""
    about = jax.jit(lambda p: linear_model(MODEL, trim_of(MODEL, p, jnp.asarray(0.1))))
    return tuple(map(np.asarray, about(jnp.asarray(-0.8))))


def entries(rows, integrals=False):
    """Rows of K as a matrix."""
    lines = [rows.buoyancy_mass, rows.mass_position, rows.mass_angle]
    matrix = [[float(getattr(r.state, name)) for name in STATES] for r in lines]
    if integrals:
        for line, row in zip(matrix, lines, strict=True):
            line += [float(x) for x in vars(row.integral).values()]
    return np.array(matrix)


def values(container):
    return np.array([float(x) for x in vars(container).values()])


def test_sampling_is_the_matrix_exponential(glide):
    a, b = glide
    for period in (0.05, 4.0):
        found = jax.jit(sampled)(a, b, jnp.asarray(period))
        whole = np.zeros((13, 13))
        whole[:10] = np.hstack([a, b])
        wanted = scipy.linalg.expm(whole * period)
        np.testing.assert_allclose(found[0], wanted[:10, :10], rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(found[1], wanted[:10, 10:], rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("name", ["lqr", "lqi"])
def test_the_regulator_gain_is_that_of_scipy(glide, name):
    law = made(name)
    a, b = glide
    q = values(law.weights)
    if name == "lqi":
        q = np.concatenate([q, values(law.integrals)])
        picks = np.eye(10)[[STATES.index(c) for c in ("depth", "pitch", "heading")]]
        a = np.block([[a, np.zeros((10, 3))], [picks, np.zeros((3, 3))]])
        b = np.vstack([b, np.zeros((3, 3))])
    n = len(q)
    whole = np.zeros((n + 3, n + 3))
    whole[:n] = np.hstack([a, b])
    step = scipy.linalg.expm(whole * float(law.period))
    ad, bd, r = step[:n, :n], step[:n, n:], np.diag(values(law.efforts))
    p = scipy.linalg.solve_discrete_are(ad, bd, np.diag(q), r)
    wanted = np.linalg.solve(r + bd.T @ p @ bd, bd.T @ p @ ad)
    found = entries(jax.jit(lambda x: x.feedback())(law).dive, name == "lqi")
    size = np.abs(wanted).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found / size, wanted / size, atol=1e-9)


def test_the_derivative_of_the_regulator_gain_is_that_of_differences(glide):
    a, b = map(jnp.asarray, glide)
    ad, bd = sampled(a, b, jnp.asarray(1.0))

    @jax.jit
    def gain(logs):
        return regulator_gain(ad, bd, jnp.diag(jnp.exp(logs)), jnp.eye(3))

    logs, along = jnp.zeros(10), jnp.linspace(-1.0, 1.0, 10)
    slope = jax.jit(lambda x: jax.jvp(gain, (x,), (along,))[1])(logs)
    step = 1e-4
    wanted = (gain(logs + step * along) - gain(logs - step * along)) / (2 * step)
    np.testing.assert_allclose(slope, wanted, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(("bandwidth", "dt"), [(0.2, 0.05), (0.1, 4.0)])
def test_the_observer_has_its_poles_where_the_formula_puts_them(bandwidth, dt):
    gains = observer_gains(jnp.asarray(bandwidth), jnp.asarray(dt))
    step = np.array([[1.0, dt, dt * dt / 2.0], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    error = (np.eye(3) - np.outer(np.array(gains), [1.0, 0.0, 0.0])) @ step
    # The polynomial, for a triple root itself is known to the cube root of rounding.
    wanted = np.poly([np.exp(-bandwidth * dt)] * 3)
    np.testing.assert_allclose(np.poly(error), wanted, atol=1e-12)


def test_adrc_estimates_what_pushes_a_channel():
    law = made("adrc")
    dt = 0.05
    push, ballast = 0.01, 0.02
    applied = Command(ballast, 0.0, 0.0)
    total = push + float(law.depth_input) * ballast

    def tick(state, t):
        seen = GliderState.at_rest(depth=0.5 * total * t * t)
        measured = Measurement(seen, seen.attitude(), applied, zeros(BodyAxes))
        z = law.estimated(state, measured, jnp.asarray(dt))
        return ADRCState(z, state.asked, jnp.asarray(1.0)), z.depth

    times = dt * jnp.arange(1200.0)
    _, z = jax.lax.scan(tick, law.init(), times)
    assert float(z.disturbance[-1]) == pytest.approx(push, rel=1e-3)
    assert float(z.rate[-1]) == pytest.approx(total * float(times[-1]), rel=1e-3)


def test_the_reaching_law_settles_in_its_time_from_however_far():
    for k1, k2, p, q in ((0.1, 0.1, 0.8, 1.2), (0.05, 0.3, 0.5, 2.0)):
        law = Reaching(k1, k2, p, q)
        bound = float(law.settling_bound())

        def slope(t, s, k1=k1, k2=k2, p=p, q=q):
            size = np.abs(s)
            return -np.sign(s) * (k1 * size**p + k2 * size**q)

        for start in (1e-2, 1.0, 1e8):
            # In the logarithm, in which the way down is smooth.
            def in_log(t, y, slope=slope):
                s = np.exp(y)
                return slope(t, s) / s

            def arrived(t, y):
                return y[0] + 30.0

            arrived.terminal = True
            run = solve_ivp(
                in_log,
                (0.0, 2.0 * bound),
                [np.log(start)],
                events=arrived,
                rtol=1e-8,
                method="LSODA",
            )
            assert run.t_events[0].size == 1
            assert run.t[-1] < bound
        if p == 0.8:
            # From infinity to zero with 1 -+ 1/mu for powers: pi mu/(2 sqrt(k1 k2)).
            exact = math.pi * 5.0 / (2.0 * math.sqrt(k1 * k2))
            assert run.t[-1] == pytest.approx(exact, rel=0.03)


def test_the_fixed_time_law_is_its_formula_on_a_double_integrator():
    """Both errors are zero after the two bounds, with the smoothing next to none."""
    outer, inner = Reaching(0.05, 0.05, 0.8, 1.2), Reaching(0.2, 0.2, 0.8, 1.2)
    kappa = 0.0
    delta = jnp.asarray(1e-4)
    bound = float(outer.settling_bound() + inner.settling_bound())
    dt = 0.01

    def tick(x, _):
        e, e1 = x
        reached, slope = jax.jvp(lambda y: outer.of(y, delta), (e,), (e1,))
        a = -slope - kappa * e - inner.of(e1 + reached, delta)
        return (e + dt * e1, e1 + dt * a), None

    start = jnp.asarray(50.0), jnp.asarray(0.0)
    end, _ = jax.lax.scan(tick, start, length=int(bound / dt))
    assert abs(float(end[0])) < 1e-2
    assert abs(float(end[1])) < 1e-3


@pytest.mark.skipif(compiled_c.COMPILER is None, reason="no C compiler here")
@pytest.mark.parametrize("name", ["seaglider", "lqi"])
def test_laws_with_looks_or_a_riccati_equation_are_the_same_in_c(name, tmp_path):
    """A law that waits, decides and remembers; and one whose K is worked out first."""
    loop = paper.make_loop("switching", "rigid-body", name)
    pilot = autopilot(loop)
    seen = fly(pilot, loop, sea(loop, 800, hold=20))[0]
    onboard = compiled_c.Onboard(tmp_path, autopilot_source(pilot, "test"))
    times = np.arange(800) * float(pilot.dt)
    told = onboard.replay(times, jax.device_get(seen.measured))
    limits = [float(a.limit) for a in vars(loop.scenario.actuators).values()]
    wanted = compiled_c.columns(seen)
    assert np.abs(wanted[:, :3]).max(axis=0).all()
    assert (np.abs(told - wanted)[:, :3] / limits).max() < 1e-10


def test_the_slope_of_the_reaching_law_is_its_derivative():
    law, delta = Reaching(0.05, 0.3, 0.5, 2.0), jnp.asarray(0.01)
    for x in (-2.0, -0.003, 0.0, 0.02, 1.5):
        found = law.slope(jnp.asarray(x), delta)
        wanted = jax.grad(law.of)(jnp.asarray(x), delta)
        assert float(found) == pytest.approx(float(wanted), rel=1e-9)
