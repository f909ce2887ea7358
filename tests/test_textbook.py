"""The laws of the textbooks, against second implementations and their theory."""

import dataclasses
import math

import compiled_c
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import solve_ivp
from scipy.optimize import nnls

from jaxglider import paper
from jaxglider.control.textbook.adrc import ADRCState, observer_gains
from jaxglider.control.textbook.fixed_time import Reaching
from jaxglider.control.textbook.linear_design import STATES, linear_model, trim_of
from jaxglider.core.riccati import regulator_gain, sampled
from jaxglider.export.autopilot import autopilot_source
from jaxglider.export.vectors import fly, sea
from jaxglider.onboard.of_loop import autopilot
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    Reference,
    zeros,
)
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


LIMIT, RATE = np.array([0.4, 0.06, math.pi / 2]), np.array([0.02, 0.005, 0.2])


def discrete(glide, law):
    """A, B of a period, P and K of SciPy."""
    a, b = glide
    whole = np.zeros((13, 13))
    whole[:10] = np.hstack([a, b])
    step = scipy.linalg.expm(whole * float(law.period))
    ad, bd = step[:10, :10], step[:10, 10:]
    q, r = np.diag(values(law.weights)), np.diag(values(law.efforts))
    p = scipy.linalg.solve_discrete_are(ad, bd, q, r)
    return ad, bd, p, np.linalg.solve(r + bd.T @ p @ bd, bd.T @ p @ ad)


def off_its_glide(rng, scale):
    """What a law sees of a glider away from its dive, and what it is asked for."""
    usual = [0.2, 0.1, 0.1, 0.15, 0.03, 0.01, 0.02, 0.02, 0.02, 0.02]
    x = scale * rng.normal(size=10) * usual
    trim = trim_of(MODEL, jnp.asarray(-0.8), jnp.asarray(0.1))
    of_trim = [float(getattr(trim.state, name)) for name in STATES]
    state = GliderState.at_rest(**dict(zip(STATES, x + of_trim, strict=True)))
    held = rng.uniform(-0.5, 0.5, 3) * scale * LIMIT
    measured = Measurement(state, state.attitude(), Command(*held), zeros(BodyAxes))
    asked = Reference(
        Channels(0.0, -0.8, 0.0),
        Channels(0.1, 0.0, 0.0),
        zeros(Channels),
        jnp.asarray(1.0),
        jnp.asarray(0, jnp.int32),
        jnp.asarray(False),
    )
    return x, values(trim.command), held, measured, asked


@pytest.fixture(scope="module")
def planner():
    """A predictive law of a short horizon, and its memory before the first run."""
    law = dataclasses.replace(made("mpc"), horizon=4)
    return law, jax.jit(lambda x: x.init())(law)


@jax.jit
def first_run(law, state, measured, asked):
    """Command and memory of a run that is due."""
    state = dataclasses.replace(state, elapsed=law.period)
    bounds = law.bounds(asked.clock)
    command, after, _ = law.step(state, measured, asked, bounds, law.period)
    return jnp.stack([*vars(command).values()]), after


def test_predictive_control_without_bounds_is_the_regulator_of_scipy(glide, planner):
    law, begun = planner
    free = Command(1e6, 1e6, 1e6)
    law = dataclasses.replace(law, limit=free, rate_limit=free)
    gain = discrete(glide, law)[3]
    rng = np.random.default_rng(0)
    x, trim, _, measured, asked = off_its_glide(rng, 0.1)
    # No error that is cut off: the law is linear there.
    assert np.abs(x[[0, 2, 3]]).max() < 0.4
    told = first_run(law, begun, measured, asked)[0]
    np.testing.assert_allclose((told - trim + gain @ x) / LIMIT, 0.0, atol=1e-9)


def best_first_move(glide, law, x, trim, held):
    """First move of the program by SciPy's least squares.

    With H = L Lᵀ it is the least distance of Lᵀv + L⁻¹f from zero within the bounds,
    which Lawson and Hanson (1974), 23.4, have from multipliers that are not negative.
    """
    ad, bd, p, _ = discrete(glide, law)
    q, r, n = np.diag(values(law.weights)), values(law.efforts), law.horizon
    powers = [np.linalg.matrix_power(ad, k) for k in range(n + 1)]
    of_x = np.vstack(powers[1:])
    of_v = np.zeros((10 * n, 3 * n))
    for k in range(n):
        for j in range(k + 1):
            block = powers[k - j] @ bd
            of_v[10 * k : 10 * k + 10, 3 * j : 3 * j + 3] = block
    cost = np.kron(np.eye(n), q)
    cost[-10:, -10:] = p
    unit = np.tile(1.0 / np.sqrt(r), n)
    hessian = (np.diag(np.tile(r, n)) + of_v.T @ cost @ of_v) * np.outer(unit, unit)
    linear = unit * (of_v.T @ cost @ of_x @ x)
    change = np.eye(3 * n) - np.eye(3 * n, k=-3)
    before = np.concatenate([held - trim, np.zeros(3 * n - 3)])
    reach, star = np.tile(float(law.period) * RATE, n), np.tile(trim, n)
    limit = np.tile(LIMIT, n)
    rows = np.vstack([np.eye(3 * n), -np.eye(3 * n), change, -change]) * unit
    room = np.concatenate([limit - star, limit + star, reach + before, reach - before])
    root = np.linalg.cholesky(hessian)
    across = np.linalg.solve(root, rows.T).T
    from_zero = np.linalg.solve(root, linear)
    least = -room - across @ from_zero
    system = np.vstack([-across.T, least])
    target = np.zeros(3 * n + 1)
    target[-1] = 1.0
    multipliers = nnls(system, target)[0]
    left = system @ multipliers - target
    moves = np.linalg.solve(root.T, -left[:-1] / left[-1] - from_zero)
    return trim + (unit * moves)[:3]


def test_predictive_control_within_bounds_is_the_program_of_scipy(glide, planner):
    law, begun = planner
    whole = dataclasses.replace(law, rounds=4000)
    met, wrong = 0, []
    for seed in range(6):
        seen = off_its_glide(np.random.default_rng(seed), 0.4 if seed < 4 else 1.0)
        x, trim, held, *given = seen
        wanted = best_first_move(glide, law, x, trim, held)
        told = np.asarray(first_run(whole, begun, *given)[0])
        np.testing.assert_allclose((told - wanted) / RATE, 0.0, atol=1e-5)
        met += np.sum(np.abs(np.abs(told - held) - RATE) < 1e-6)
        short = np.asarray(first_run(law, begun, *given)[0])
        assert np.all(np.abs(short - held) < RATE + 1e-9)
        assert np.all(np.abs(short) < LIMIT + 1e-9)
        wrong.append(np.abs((short - wanted) / RATE))
    # Some moves are as fast as they may be, some are not.
    assert 6 < met < 16
    # Ten rounds from nothing are a fraction of a step off, on the slow ballast.
    assert np.mean(wrong) < 0.05
    assert np.max(wrong) < 0.4


def test_the_derivative_of_predictive_control_is_that_of_differences(planner):
    law, _ = planner
    # One move as fast as may be, two between.
    _, _, _, measured, asked = off_its_glide(np.random.default_rng(2), 0.4)

    def turned(container, start, share):
        """The numbers of a container, each on its own way up or down."""
        ways = (jnp.exp(share * math.sin(1.7 * (start + n))) for n in range(10))
        return jax.tree.map(lambda x: x * next(ways), container)

    def told(share):
        weights = turned(law.weights, 0, share)
        efforts = turned(law.efforts, 10, share)
        changed = dataclasses.replace(law, weights=weights, efforts=efforts)
        command = first_run(changed, changed.init(), measured, asked)[0]
        return command @ (1.0 / RATE)

    both = jax.jit(lambda share: jax.jvp(told, (share,), (jnp.ones(()),)))
    slope = float(both(jnp.zeros(()))[1])
    assert abs(slope) > 1e-3
    ahead, behind = (float(both(jnp.asarray(h))[0]) for h in (1e-4, -1e-4))
    assert slope == pytest.approx((ahead - behind) / 2e-4, rel=1e-5)


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
@pytest.mark.parametrize("name", ["seaglider", "lqi", "mpc"])
def test_laws_with_looks_or_a_riccati_equation_are_the_same_in_c(name, tmp_path):
    """A law that waits, decides and remembers; and two that are designed first."""
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
