"""The disturbance observer finds what pushes the glider."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_physics import array, columns

from jaxglider import paper
from jaxglider.control.observer import FixedTimeObserver, NoObserver, ObserverState
from jaxglider.signals import BodyAxes, Command, GliderState, Measurement
from jaxglider.vehicle.plant import printed_plant
from jaxglider.vehicle.published import load_vehicle

DT = 0.05
STATE_NAMES = ("surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate")
PARAMETERS = load_vehicle("seawing").parameters
MODEL = paper.design_model(printed_plant(PARAMETERS), factor=1.0)
AMPLITUDE = np.array([0.02, 0.01, -0.02, 0.01, 0.02, -0.01])
FREQUENCY = np.pi / 100


def same(value):
    return BodyAxes(*(value,) * 6)


def at(state, command=(0.0, 0.0, 0.0)):
    return Measurement(state, state.attitude(), Command(*command), same(0.0))


def phi1(y, stretch, smoothing):
    size = np.sqrt(y * y + smoothing**2)
    return y * size**-0.5 + stretch * y * size**0.5


def phi2(y, stretch, smoothing):
    size = np.sqrt(y * y + smoothing**2)
    return 0.5 * y / size + 2 * stretch * y + 1.5 * stretch**2 * y * size


def in_convergence_set(proportional, integral, largest_rate):
    """The paper's set of observer gains for a bound on the rate of the disturbance."""
    if proportional <= 2 * np.sqrt(largest_rate):
        return integral > proportional**2 / 4 + 4 * largest_rate**2 / proportional**2
    return integral > largest_rate


@pytest.fixture(scope="module")
def watch():
    """Estimates while a glider under a known disturbance is watched.

    The glider moves by Euler steps of the observer's own model, so that the disturbance
    is all that the model leaves unexplained.
    """

    def watch(observer, disturbance):
        command = Command(0.3, 0.02, 0.1)
        start = GliderState.at_rest(pitch=-0.5, surge=0.3)

        def tick(carry, push):
            state, memory = carry
            m = Measurement(state, state.attitude(), command, observer.estimate(memory))
            rates = printed_plant(observer.model.parameters).derivative(
                state, command, push
            )
            following = jax.tree.map(lambda x, k: x + DT * k, state, rates)
            memory = observer.step(memory, m, command, following, jnp.asarray(DT))
            return (following, memory), observer.estimate(memory)

        return jax.lax.scan(tick, (start, observer.init(start)), disturbance)[1]

    return jax.jit(watch)


@pytest.mark.parametrize("kind", ["constant", "slow"])
def test_estimate_converges_on_all_axes_with_gains_from_the_paper_s_set(watch, kind):
    proportional, integral, stretch, smoothing = 0.2, 0.05, 18.0, 1e-3
    rate = np.abs(AMPLITUDE).max() * FREQUENCY
    assert in_convergence_set(proportional, integral, rate)
    observer = FixedTimeObserver(
        MODEL, same(proportional), same(integral), same(stretch), smoothing
    )
    times = DT * np.arange(3000)[:, None]
    if kind == "constant":
        disturbance = AMPLITUDE + 0 * times
        tolerance = 1e-9
    else:
        disturbance = AMPLITUDE * np.sin(FREQUENCY * times)
        # The smoothed signum must lean by y = 2 δ d'/ι₂ to follow a slope d'; the
        # estimate is then late by ι₁ φ₁(y), and by the tick.
        lean = 2 * smoothing * rate / integral
        tolerance = 1.5 * proportional * phi1(lean, stretch, smoothing) + rate * DT
        assert tolerance < 0.02 * np.abs(AMPLITUDE).max()
    found = array(watch(observer, columns(BodyAxes, disturbance)))
    error = np.abs(found - disturbance)
    assert error[0].max() > 0.5 * np.abs(disturbance[0]).max()
    assert error[1000:].max() < tolerance


def test_step_satisfies_its_implicit_equation():
    rng = np.random.default_rng(21)
    count = 200
    observer = paper.fixed_time_observer(MODEL)
    size = 10.0 ** rng.uniform(-6, 0, (count, 6))
    velocity = rng.uniform(-0.1, 0.1, (count, 6))
    believed = velocity + size * rng.choice([-1, 1], (count, 6))
    estimate = 0.05 * rng.uniform(-1, 1, (count, 6))
    # At rest and level without command, no force is expected.
    still = at(GliderState.at_rest())

    def step(v, w, d):
        following = dataclasses.replace(
            GliderState.at_rest(), **dict(zip(STATE_NAMES, v.fields(), strict=True))
        )
        return observer.step(
            ObserverState(w, d), still, still.applied, following, jnp.asarray(DT)
        )

    after = jax.jit(jax.vmap(step))(
        *(columns(BodyAxes, x) for x in (velocity, believed, estimate))
    )
    inertia = array(PARAMETERS.inertia())
    i1, i2, stretch = (
        array(getattr(observer, name))
        for name in ("proportional", "integral", "stretch")
    )
    smoothing = float(observer.smoothing)
    y = inertia * (velocity - array(after.velocity))
    b = inertia * (velocity - believed) - DT * estimate
    left = y + DT * i1 * phi1(y, stretch, smoothing)
    left += DT**2 * i2 * phi2(y, stretch, smoothing)
    np.testing.assert_allclose(left, b, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(
        array(after.disturbance) - estimate,
        DT * i2 * phi2(y, stretch, smoothing),
        rtol=1e-6,
        atol=1e-12,
    )


DURATION = 3.0
PAPER_S_ROLL = (0.01, 0.1, 180.0)
DAMPED = (1.0, 0.1, 18.0)


def push(t):
    """A roll moment that starts suddenly and then wanders."""
    return 0.03 + 0.02 * np.sin(2.0 * t)


def impulse(t):
    """Its integral."""
    return 0.03 * t + 0.01 * (1 - np.cos(2.0 * t))


def explicit(dt, i1, i2, stretch, smoothing=1e-3):
    """d̂ at the end, by explicit Euler on Π' = d − ι₁φ₁(Π) − d̂ and d̂' = ι₂φ₂(Π)."""
    pi = estimate = 0.0
    for force in push(dt * np.arange(round(DURATION / dt))).tolist():
        size = (pi * pi + smoothing * smoothing) ** 0.5
        root = size**0.5
        first = pi * (1 / root + stretch * root)
        second = pi * (0.5 / size + stretch * (2 + 1.5 * stretch * size))
        pi, estimate = (
            pi + dt * (force - i1 * first - estimate),
            estimate + dt * i2 * second,
        )
        if abs(estimate) > 1e6:
            return np.inf
    return estimate


@pytest.fixture(scope="module")
def implicit():
    """d̂ at the end, by the steps of the observer on the roll axis."""
    still = at(GliderState.at_rest())

    @jax.jit
    def watch(gains, rates, dt):
        i1, i2, stretch = gains
        observer = FixedTimeObserver(MODEL, same(i1), same(i2), same(stretch))

        def tick(memory, rate):
            following = GliderState.at_rest(roll_rate=rate)
            return observer.step(memory, still, still.applied, following, dt), None

        start = observer.init(GliderState.at_rest())
        return jax.lax.scan(tick, start, rates)[0].disturbance.roll

    def implicit(dt, gains):
        times = dt * (1 + np.arange(round(DURATION / dt)))
        rates = impulse(times) / float(PARAMETERS.roll_inertia)
        return float(watch(gains, rates, dt))

    return implicit


def test_steps_converge_to_the_continuous_observer_in_first_order(implicit):
    exact = explicit(1e-5, *DAMPED)
    errors = [abs(implicit(dt, DAMPED) - exact) for dt in (0.05, 0.01, 0.002)]
    assert errors[0] < 0.02 * abs(exact)
    assert errors[1] < 0.3 * errors[0]
    assert errors[2] < 0.3 * errors[1]


def test_explicit_euler_blows_up_at_twenty_hertz_where_the_implicit_step_follows(
    implicit,
):
    assert explicit(DT, *PAPER_S_ROLL) == np.inf
    assert abs(implicit(DT, PAPER_S_ROLL) - push(DURATION)) < 0.1 * push(DURATION)


def test_gradient_through_one_step_agrees_with_differences():
    still = at(GliderState.at_rest())

    def after(numbers):
        i1, i2, stretch, smoothing, rate, estimate = numbers
        observer = FixedTimeObserver(
            MODEL, same(i1), same(i2), same(stretch), smoothing
        )
        memory = ObserverState(same(0.0), same(estimate))
        following = GliderState.at_rest(roll_rate=rate)
        result = observer.step(memory, still, still.applied, following, jnp.asarray(DT))
        return jnp.stack([result.disturbance.roll, result.velocity.roll])

    value = jax.jit(jax.vmap(after))
    jacobian = jax.jit(jax.jacfwd(after))
    rate, inertia = 0.02, float(PARAMETERS.roll_inertia)
    for mismatch in (0.0, 1e-4, -3e-2, 0.5):
        # Of this estimate the right-hand side of the equation is the mismatch.
        estimate = (inertia * rate - mismatch) / DT
        numbers = np.array([0.01, 0.1, 180.0, 1e-3, rate, estimate])
        steps = np.diag(1e-5 * np.abs(numbers))
        above, below = value(numbers + steps), value(numbers - steps)
        slope = (above - below).T / (2e-5 * np.abs(numbers))
        found = jacobian(numbers)
        assert np.all(
            np.abs(found - slope) <= 5e-5 * np.abs(slope) + 1e-9 / np.abs(numbers)
        )
        assert np.all(np.abs(found[:, 4]) > 1e-3)


def test_no_observer_estimates_nothing():
    observer = NoObserver()
    state = GliderState.at_rest(surge=0.3, pitch=-0.4)
    memory = observer.init(state)
    for _ in range(2):
        memory = observer.step(
            memory, at(state), Command(0.1, 0.0, 0.2), state, jnp.asarray(DT)
        )
        assert array(observer.estimate(memory)).tolist() == [0.0] * 6


def test_observer_starts_without_an_error_and_without_an_estimate():
    state = GliderState.at_rest(surge=0.3, pitch_rate=0.01)
    memory = paper.fixed_time_observer(MODEL).init(state)
    assert array(memory.velocity).tolist() == [0.3, 0, 0, 0, 0.01, 0]
    assert array(memory.disturbance).tolist() == [0.0] * 6


@pytest.mark.parametrize("name", ["proportional", "integral", "stretch"])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_gains_that_are_not_positive_are_refused(name, value):
    good = paper.fixed_time_observer(MODEL)
    bad = dataclasses.replace(getattr(good, name), heave=value)
    with pytest.raises(ValueError, match=rf"{name}\.heave must be positive; received"):
        dataclasses.replace(good, **{name: bad})


def test_smoothing_that_is_not_positive_is_refused():
    with pytest.raises(ValueError, match="smoothing must be positive"):
        dataclasses.replace(paper.fixed_time_observer(MODEL), smoothing=0.0)
