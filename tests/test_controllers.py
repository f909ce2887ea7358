"""The laws agree with their formulas written out in matrices."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_physics import MatrixGlider, array, columns, random_commands, random_states

from jaxglider import (
    PPC,
    SMC,
    Actuator,
    Calm,
    ChannelGains,
    ClosedLoop,
    Funnel,
    FxTPPC,
    NoObserver,
    RollAwareFxTPPC,
    paper,
    simulate,
)
from jaxglider.control.fxtppc import (
    FxTPPCState,
    paper_exponents,
    reaching_law,
    tian_exponents,
)
from jaxglider.control.fxtppc_roll import RollAwareState
from jaxglider.control.prescribed.performance import HalfSechFunction, SechFunction
from jaxglider.control.prescribed.transform import ErrorTransformation
from jaxglider.core.numerics import signed_powers
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    Reference,
)
from jaxglider.vehicle.design_model import DesignModel
from jaxglider.vehicle.plant import printed_plant
from jaxglider.vehicle.published import load_vehicle

COUNT = 16
PARAMETERS = load_vehicle("seawing").parameters
MODEL = paper.design_model(printed_plant(PARAMETERS))
GLIDER = MatrixGlider(PARAMETERS.scaled(0.8), rigid_body=False)
DAMPING = np.array([1e-4, 2e-4, 3e-4])
LOWER, UPPER = np.array([0.9, 0.8, 1.0]), np.array([1.0, 0.7, 0.85])
SHAPES = np.array([[1.0, 0.2, 100.0], [0.9, 0.17, 80.0], [0.8, 0.26, 60.0]])
K1, K2 = np.array([0.001, 0.01, 0.002]), np.array([0.01, 0.2, 0.08])
RHO, MU = np.array([0.8, 0.7, 0.9]), np.array([2.0, 3.0, 1.5])
L0, MARGIN = np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.15, 0.2])
L2 = np.array([1.0, 1.5, 3.0])
C0, C1, C2 = np.array([0.1, 0.2, 0.3]), np.array([1.0, 1.1, 1.2]), np.array([5, 4, 3])


def sig(x, power):
    return np.abs(x) ** power * np.sign(x)


def printed_form(form, numbers, t):
    p0, final, duration = numbers
    stretched = duration / (duration - t)
    if form is SechFunction:
        return 1 / jnp.cosh(stretched / jnp.cosh(p0)) + final
    y = jnp.exp(p0 * stretched)
    return y / (1 + y**2) + final


@partial(jax.jit, static_argnums=0)
def printed_rates(form, clocks):
    """P, P' and P'' of the printed form, one row for each clock."""

    def rates(t, numbers):
        def p(t):
            return printed_form(form, numbers, t)

        return p(t), jax.grad(p)(t), jax.grad(jax.grad(p))(t)

    across = jax.vmap(rates, in_axes=(None, 0))
    return jax.vmap(across, in_axes=(0, None))(clocks, jnp.asarray(SHAPES))


def funnel_of(form):
    performance = Channels(*(form(*row) for row in SHAPES))
    transformations = [
        ErrorTransformation(*row) for row in zip(LOWER, UPPER, strict=True)
    ]
    return Funnel(performance, Channels(*transformations))


def channels(values):
    return Channels(*map(float, values))


def controllers():
    damping = Command(*map(float, DAMPING))
    gains = Channels(
        *(ChannelGains(*map(float, row)) for row in zip(K1, K2, RHO, MU, strict=True))
    )

    def fxtppc(exponents):
        # Next to no smoothing: the printed powers have none.
        return FxTPPC(MODEL, funnel_of(SechFunction), gains, damping, 1e-14, exponents)

    return {
        "fxtppc, paper's pairing": fxtppc(paper_exponents),
        "fxtppc, Tian's pairing": fxtppc(tian_exponents),
        "ppc": PPC(
            MODEL,
            funnel_of(HalfSechFunction),
            channels(L0),
            channels(MARGIN),
            channels(L2),
            damping,
        ),
        "smc": SMC(MODEL, channels(C0), channels(C1), channels(C2), damping),
    }


CONTROLLERS = controllers()


class Situation:
    """Random states with errors inside the funnel, in NumPy."""

    def __init__(self, form, seed=31):
        rng = np.random.default_rng(seed)
        self.states = random_states(rng, COUNT)
        self.applied = random_commands(rng, COUNT)
        self.asked = self.applied + 0.1 * random_commands(rng, COUNT)
        self.estimate = 0.05 * rng.uniform(-1, 1, (COUNT, 6))
        self.clock = rng.uniform(0, 55, COUNT)
        self.integral = rng.uniform(-0.5, 0.5, (COUNT, 3))
        self.p, self.p1, self.p2 = map(np.asarray, printed_rates(form, self.clock))
        share = rng.uniform(-0.9, 0.9, (COUNT, 3))
        self.e = share * self.p * np.where(share > 0, UPPER, LOWER)
        eta = self.states[:, [2, 4, 5]]
        # Whole turns between heading and reference must not matter.
        turns = 2 * np.pi * rng.integers(-2, 3, COUNT)
        self.wanted = eta - self.e
        self.wanted[:, 2] += turns
        rate = rng.uniform(-0.1, 0.1, (COUNT, 3))
        self.e1 = (
            np.array([GLIDER.output_map(x[3], x[4]) @ x[6:] for x in self.states])
            - rate
        )
        self.wanted1 = rate
        self.wanted2 = rng.uniform(-0.01, 0.01, (COUNT, 3))

    def run(self, step, controller):
        state = columns(Channels, self.integral)
        if isinstance(controller, RollAwareFxTPPC):
            state = RollAwareState(state, columns(Command, self.asked))
        else:
            state = FxTPPCState(state) if isinstance(controller, FxTPPC) else None
        return step(
            controller,
            state,
            columns(GliderState, self.states),
            columns(Command, self.applied),
            columns(BodyAxes, self.estimate),
            tuple(
                columns(Channels, x) for x in (self.wanted, self.wanted1, self.wanted2)
            ),
            jnp.asarray(self.clock),
        )

    def input_gain(self, n):
        """h and g of one of the states."""
        phi, theta = self.states[n, 3:5]
        h = GLIDER.output_map(phi, theta) @ np.linalg.inv(GLIDER.inertia)
        return h, h @ GLIDER.effectiveness(phi, theta, self.applied[n, 2])

    def invert(self, demand):
        """U from the wanted η'', by damped normal equations."""
        commands = []
        for n, x in enumerate(self.states):
            phi, theta, nu = x[3], x[4], x[6:]
            h, g = self.input_gain(n)
            free = (GLIDER.coriolis(nu) + GLIDER.damping(nu)) @ nu
            free += GLIDER.restoring(phi, theta)
            f = self.turning(x) + h @ free
            right = g.T @ (demand[n] - f - h @ self.estimate[n])
            commands.append(np.linalg.solve(g.T @ g + np.diag(DAMPING), right))
        return np.array(commands)

    @staticmethod
    def turning(x):
        """J' ν, with J' from a central difference along the motion."""
        phi, theta, nu = x[3], x[4], x[6:]
        phi1, theta1 = (GLIDER.euler_map(phi, theta) @ nu[3:])[:2]
        h = 1e-5
        ahead = GLIDER.output_map(phi + h * phi1, theta + h * theta1)
        behind = GLIDER.output_map(phi - h * phi1, theta - h * theta1)
        return (ahead - behind) @ nu / (2 * h)

    def transformed(self):
        """ε, ε', λ, λ' and κ as printed."""
        x, p, p1 = self.e / self.p, self.p, self.p1
        eps = 0.5 * np.log((LOWER + x) / (UPPER - x))
        both = 1 / (LOWER + x) + 1 / (UPPER - x)
        lam = both / (2 * p)
        x1 = (self.e1 * p - self.e * p1) / p**2
        lam1 = -p1 / (2 * p**2) * both + x1 / (2 * p) * (
            1 / (UPPER - x) ** 2 - 1 / (LOWER + x) ** 2
        )
        slope = (self.e1 * p - self.e * p1) / p
        kappa = lam1 * slope + lam * (
            (-self.e1 * p1 * p - self.e * self.p2 * p + self.e * p1**2) / p**2
        )
        return eps, lam * slope, lam, lam1, kappa


@pytest.fixture(scope="module")
def step():
    def one(controller, state, glider, applied, estimate, wanted, clock):
        reference = Reference(
            *wanted, clock, jnp.asarray(0, jnp.int32), jnp.asarray(False)
        )
        measurement = Measurement(glider, glider.attitude(), applied, estimate)
        bounds = controller.bounds(clock)
        return controller.step(state, measurement, reference, bounds, jnp.asarray(0.05))

    # In a loop, which compiles fastest.
    return jax.jit(
        lambda controller, *rows: jax.lax.map(lambda row: one(controller, *row), rows)
    )


@pytest.mark.parametrize("pairing", ["paper", "tian"])
def test_fxtppc_is_the_law_of_the_paper(step, pairing):
    name = {"paper": "fxtppc, paper's pairing", "tian": "fxtppc, Tian's pairing"}
    s = Situation(SechFunction)
    command, state, record = s.run(step, CONTROLLERS[name[pairing]])
    first, second = RHO / (2 - RHO), RHO
    third, fourth = (4 - 3 * RHO) / (2 - RHO), (4 - 3 * RHO) / (3 - 2 * RHO)
    for_e1, for_e2 = (first, second), (third, fourth)
    if pairing == "tian":
        for_e1, for_e2 = (first, third), (second, fourth)
    e1, e2, lam, _, kappa = s.transformed()
    sliding = K1 * (sig(e1, for_e1[0]) + e1 + sig(e1, for_e1[1]))
    sliding += K2 * (sig(e2, for_e2[0]) + e2 + sig(e2, for_e2[1]))
    surface = e2 + s.integral
    reach = sig(surface, 1 + 1 / MU) + surface + sig(surface, 1 - 1 / MU)
    u_eps, u_s = -sliding / lam, -(K1 * reach + K2 * reach) / lam
    expected = s.invert(-kappa / lam + s.wanted2 + u_eps + u_s)
    np.testing.assert_allclose(array(command), expected, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(array(record.surface), surface, rtol=1e-10)
    np.testing.assert_allclose(array(record.error), s.e, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        array(state.integral), s.integral + 0.05 * sliding, rtol=1e-10
    )


def test_the_roll_aware_law_adds_its_formulas_to_the_papers(step):
    law = CONTROLLERS["fxtppc, paper's pairing"]
    share, damping, largest, hedging = 0.4, 1.2, 0.3, 0.7
    aware = RollAwareFxTPPC(law, share, damping, largest, hedging)
    s = Situation(SechFunction)
    command, state, record = s.run(step, aware)
    # From the hedged integral it is the paper's law, tested above.
    lam = s.transformed()[2]
    kept_back = s.applied - s.asked
    hedge = [s.input_gain(n)[1] @ kept_back[n] for n in range(COUNT)]
    s.integral = s.integral - 0.05 * hedging * lam * np.array(hedge)
    wanted, inner, plain = s.run(step, law)
    asked = array(wanted)
    asked[:, 2] += share * s.states[:, 3]
    steered = asked.copy()
    steered[:, 2] = np.clip(asked[:, 2], -largest, largest) - damping * s.states[:, 9]
    assert 0 < np.sum(np.abs(asked[:, 2]) > largest) < COUNT
    close = {"rtol": 1e-7, "atol": 1e-10}
    np.testing.assert_allclose(array(command), steered, **close)
    np.testing.assert_allclose(array(state.asked), asked, **close)
    np.testing.assert_allclose(array(state.integral), array(inner.integral), **close)
    np.testing.assert_allclose(array(record.surface), array(plain.surface), **close)


def test_a_hedged_surface_settles_in_time_whatever_the_actuator_can_do():
    # A mass that turns by 0.1 rad at most, where the turn asks for all it can get.
    setting = paper.make_scenario(
        "switching", "rigid-body", duration=40.0, actuators="ideal"
    )
    actuators = dataclasses.replace(setting.actuators, mass_angle=Actuator(0.1))
    setting = dataclasses.replace(setting, disturbance=Calm(), actuators=actuators)
    model = paper.design_model(setting.plant, 1.0)
    k1, k2, mu = 0.1, 0.4, 2.0
    law = dataclasses.replace(
        paper.make_controller("fxtppc", "switching", model, paper.INVERSION),
        gains=Channels(*(ChannelGains(k1, k2, mu=mu),) * 3),
        damping=Command(1e-8, 1e-8, 1e-8),
    )

    @jax.jit
    def surface(hedging):
        aware = RollAwareFxTPPC(law, 0.0, 0.0, np.pi / 2, hedging)
        loop = ClosedLoop(setting, aware, NoObserver())
        ticks = simulate(loop, setting.sea(jax.random.key(0))).ticks
        return ticks.surface.heading, ticks.applied.mass_angle

    # Both terms of u_s with k1 + k2: within 2μ/(k1 + k2), 8 s.
    settled = round(2 * mu / (k1 + k2) / 0.05)
    hedged, angle = map(np.asarray, surface(1.0))
    assert np.mean(np.abs(angle) > 0.0999) > 0.7
    assert np.abs(hedged[settled:]).max() < 1e-3
    wound_up, _ = map(np.asarray, surface(0.0))
    assert np.abs(wound_up[settled:]).min() > 1.0


def test_the_roll_aware_law_is_the_papers_where_nothing_is_added(step):
    law = CONTROLLERS["fxtppc, paper's pairing"]
    s = Situation(SechFunction)
    s.applied[:, 2] *= 0.1
    wanted, inner, _ = s.run(step, law)
    inside = np.abs(array(wanted)[:, 2]) < np.pi / 2
    assert np.any(inside)
    aware = RollAwareFxTPPC(law, 0.0, 0.0, np.pi / 2, 0.0)
    command, state, _ = s.run(step, aware)
    # Two programs: they may round differently.
    np.testing.assert_allclose(array(command)[inside], array(wanted)[inside], 1e-12)
    np.testing.assert_allclose(array(state.integral), array(inner.integral), 1e-12)


@pytest.mark.parametrize(
    ("field", "value", "rule"),
    [
        ("roll_share", -0.1, r"in \[0, 1\)"),
        ("roll_share", 1.0, r"in \[0, 1\); received 1.0"),
        ("roll_damping", -1.0, "zero or positive"),
        ("largest_angle", 1.6, r"in \(0, 1.5708\]"),
        ("hedging", 1.1, r"in \[0, 1\]"),
    ],
)
def test_the_roll_aware_law_refuses_what_is_outside_its_sets(field, value, rule):
    aware = RollAwareFxTPPC(CONTROLLERS["fxtppc, paper's pairing"])
    with pytest.raises(ValueError, match=rf"RollAwareFxTPPC\.{field} must be {rule}"):
        dataclasses.replace(aware, **{field: value})


def test_ppc_is_the_law_of_the_paper(step):
    s = Situation(HalfSechFunction)
    command, _, record = s.run(step, CONTROLLERS["ppc"])
    eps, eps1, lam, lam1, kappa = s.transformed()
    q = eps1 + L0 * eps
    inverse_rate = -lam1 / lam**2
    assert inverse_rate.min() < 0.0 < inverse_rate.max()
    l1 = np.maximum(inverse_rate, 0.0) + MARGIN
    assert np.all(inverse_rate - l1 < 0.0)
    expected = s.invert(-kappa / lam + s.wanted2 - l1 * q - L2 * np.tanh(q))
    np.testing.assert_allclose(array(command), expected, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(array(record.surface), q, rtol=1e-9, atol=1e-12)


def test_smc_is_the_law_of_the_paper(step):
    s = Situation(SechFunction)
    command, _, record = s.run(step, CONTROLLERS["smc"])
    p = s.e1 + C0 * s.e
    expected = s.invert(-C0 * s.e1 + s.wanted2 - C1 * p - C2 * np.tanh(p))
    np.testing.assert_allclose(array(command), expected, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(array(record.surface), p, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_estimate_enters_every_law_through_h(step, name):
    s = Situation(HalfSechFunction if name == "ppc" else SechFunction)
    with_estimate, _, _ = s.run(step, CONTROLLERS[name])
    estimate, s.estimate = s.estimate, 0 * s.estimate
    without, _, _ = s.run(step, CONTROLLERS[name])
    found = array(with_estimate) - array(without)
    for n in range(COUNT):
        h, g = s.input_gain(n)
        right = -g.T @ h @ estimate[n]
        expected = np.linalg.solve(g.T @ g + np.diag(DAMPING), right)
        np.testing.assert_allclose(found[n], expected, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_edges_of_the_funnel_are_the_scaled_performance_function(name):
    controller = CONTROLLERS[name]
    clock = jnp.asarray(20.0)
    limits = controller.limits(controller.bounds(clock))
    form = HalfSechFunction if name == "ppc" else SechFunction
    for n, channel in enumerate(("depth", "pitch", "heading")):
        found = getattr(limits, channel)
        p = np.inf if name == "smc" else float(printed_form(form, SHAPES[n], 20.0))
        lower, upper = (1.0, 1.0) if name == "smc" else (LOWER[n], UPPER[n])
        np.testing.assert_allclose(
            [float(found.lower), float(found.upper)], [-lower * p, upper * p]
        )


def settling_times(law, starts, gain=1.0):
    """When x' = −gain law(x) comes within 1e-14 of zero; followed as log x.

    From there each law needs less than 1e-5 to zero.
    """
    rate = jax.jit(law)

    def log_rate(_, y):
        x = np.exp(y[0])
        return [-gain * float(rate(x)) / x]

    def arrived(_, y):
        return y[0] - np.log(1e-14)

    arrived.terminal = True
    times = []
    for start in starts:
        solution = solve_ivp(
            log_rate, (0, 1e4), [np.log(start)], events=arrived, rtol=1e-8, atol=1e-8
        )
        times.append(solution.t_events[0][0])
    return np.array(times)


def test_two_power_law_settles_at_its_exact_times_and_within_its_bound():
    p, q, tiny = 0.5, 1.5, jnp.asarray(1e-25)

    def law(x):
        low, high = signed_powers(x, (jnp.asarray(p), jnp.asarray(q)), tiny)
        return low + high

    starts = np.array([1e-2, 1.0, 10.0, 1e6])
    found = settling_times(law, starts)
    np.testing.assert_allclose(found, 2 * np.arctan(np.sqrt(starts)), atol=2e-6)
    np.testing.assert_allclose(found[1:3], [1.5708, 2.52904], atol=1e-4)
    # The bound of the theory holds, and so does the supremum, approached from below.
    assert np.all(found <= 1 / (1 - p) + 1 / (q - 1))
    assert np.all(found < np.pi)
    np.testing.assert_allclose(found[-1], np.pi, atol=3e-3)


@pytest.mark.parametrize(("mu", "gain"), [(2.0, 1.0), (1.5, 0.08), (2.5, 0.5)])
def test_reaching_law_settles_within_its_bound_from_anywhere(mu, gain):
    def law(s):
        return reaching_law(s, jnp.asarray(mu), jnp.asarray(1e-25))

    starts = 10.0 ** np.arange(-2, 7, 2)
    found = settling_times(law, starts, gain)
    # With z = s^(1/μ) the time is μ/k times the integral of dz/(z² + z + 1).
    root = np.sqrt(3)
    exact = 2 * np.arctan((2 * starts ** (1 / mu) + 1) / root) / root - np.pi / 3 / root
    np.testing.assert_allclose(found, mu / gain * exact, rtol=2e-4)
    # What it tends to from ever farther away is the bound, and nothing reaches it.
    bound = float(ChannelGains(gain / 3, 2 * gain / 3, mu=mu).settling_bound())
    assert bound == pytest.approx(1.2091995761561452 * mu / gain)
    assert np.all(found < bound)
    assert found[-1] > 0.98 * bound if mu < 2 else found[-1] > 0.95 * bound


@pytest.mark.parametrize(
    ("gains", "name", "rule"),
    [
        ({"rho": 0.0}, "rho", r"in \(0, 1\)"),
        ({"rho": 1.0}, "rho", r"in \(0, 1\)"),
        ({"rho": -0.2}, "rho", r"in \(0, 1\)"),
        ({"rho": 1.2}, "rho", r"in \(0, 1\)"),
        ({"mu": 1.0}, "mu", "above 1"),
        ({"mu": 0.5}, "mu", "above 1"),
        ({"k1": -0.001}, "k1", "positive"),
        ({"k1": 0.0}, "k1", "positive"),
        ({"k2": -0.1}, "k2", "positive"),
        ({"k2": float("nan")}, "k2", "finite|positive"),
    ],
)
def test_gains_outside_the_theory_are_refused(gains, name, rule):
    good = {"k1": 0.001, "k2": 0.01, "rho": 0.8, "mu": 2.0}
    with pytest.raises(ValueError, match=rf"ChannelGains\.{name} must be ({rule})"):
        ChannelGains(**{**good, **gains})


@pytest.mark.parametrize(
    ("name", "field"),
    [("smc", "c0"), ("smc", "c2"), ("ppc", "l1_margin"), ("ppc", "damping")],
)
def test_gains_of_the_baselines_must_be_positive(name, field):
    controller = CONTROLLERS[name]
    container = getattr(controller, field)
    channel = dataclasses.fields(container)[1].name
    bad = dataclasses.replace(container, **{channel: -1.0})
    with pytest.raises(ValueError, match=rf"{field}\.{channel} must be positive"):
        dataclasses.replace(controller, **{field: bad})


def test_smoothing_of_the_fixed_time_law_must_be_positive():
    with pytest.raises(ValueError, match="smoothing must be positive; received 0"):
        dataclasses.replace(CONTROLLERS["fxtppc, paper's pairing"], smoothing=0.0)


def test_controller_knows_the_design_model_and_not_the_plant():
    for controller in CONTROLLERS.values():
        assert isinstance(controller.model, DesignModel)
        assert float(controller.model.parameters.surge_mass) == 0.8 * 66.76
        assert float(controller.model.parameters.moving_mass) == 11.0
