import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxglider.signals import Command
from jaxglider.vehicle.actuators import Actuator, follow_all

DT = 0.05


def _positions(actuator, commands, start=0.0, dt=DT):
    """Position after each tick."""

    def tick(held, wanted):
        held = actuator.follow(held, wanted, jnp.asarray(dt))
        return held, held

    return lax.scan(tick, jnp.asarray(start), jnp.asarray(commands))[1]


def test_an_ideal_actuator_follows_at_once_within_its_limit():
    commands = [0.1, -0.3, 0.39, 0.4, 5.0, -7.0, 0.0]
    got = _positions(Actuator(0.4), commands)
    np.testing.assert_allclose(got, np.clip(commands, -0.4, 0.4), atol=1e-16)


def test_a_rate_limit_turns_a_step_into_a_ramp():
    got = _positions(Actuator(0.4, rate_limit=0.3), np.full(40, 9.0))
    ramp = 0.3 * DT * np.arange(1, 41)
    np.testing.assert_allclose(got, np.minimum(ramp, 0.4), atol=1e-15)
    down = _positions(Actuator(0.4, rate_limit=0.3), np.full(60, -9.0), start=0.4)
    np.testing.assert_allclose(
        down, np.maximum(0.4 - 0.3 * DT * np.arange(1, 61), -0.4), atol=1e-15
    )


def test_a_lag_answers_a_step_exponentially():
    got = _positions(Actuator(1.0, time_constant=0.7), np.full(50, 0.5), start=-0.2)
    t = DT * np.arange(1, 51)
    np.testing.assert_allclose(got, 0.5 - 0.7 * np.exp(-t / 0.7), rtol=1e-13)


def test_a_lag_does_not_depend_on_the_tick():
    actuator = Actuator(1.0, time_constant=0.7)
    coarse = _positions(actuator, np.full(10, 0.5), dt=0.2)
    fine = _positions(actuator, np.full(40, 0.5), dt=0.05)
    np.testing.assert_allclose(coarse, fine[3::4], rtol=1e-13)


def test_a_lag_follows_the_saturated_command():
    got = _positions(Actuator(0.4, time_constant=0.1), np.full(200, 100.0))
    assert float(got[0]) == pytest.approx(0.4 * (1 - np.exp(-0.5)))
    assert float(got[-1]) == pytest.approx(0.4)
    assert np.all(np.asarray(got) <= 0.4)


def test_in_its_dead_band_an_actuator_stands():
    """Small commands leave it where it is; on a move it stops at the band's edge."""
    servo = Actuator(1.0, rate_limit=0.3, dead_band=0.02)
    places, expected, now = [0.01, 0.05, 0.06, 0.5, 0.49, -2.0], [], 0.0
    commands = np.repeat(places, 40)
    for wanted in commands:
        left = min(max(wanted, -1.0), 1.0) - now
        if abs(left) > 0.02:
            now += min(max(left, -0.3 * DT), 0.3 * DT)
        expected.append(now)
    got = np.asarray(_positions(servo, commands))
    np.testing.assert_allclose(got, expected, atol=1e-12)
    assert np.all(got[:40] == 0.0)
    assert np.ptp(got[160:200]) == 0.0


def test_lag_and_rate_limit_together_ramp_until_the_lag_is_slower():
    rate, tau = 0.3, 0.7
    got = np.asarray(_positions(Actuator(1.0, rate, tau), np.full(100, 0.8)))
    wanted, held = [], 0.0
    for _ in range(100):
        lagged = (1 - np.exp(-DT / tau)) * (0.8 - held)
        held += min(lagged, rate * DT)
        wanted.append(held)
    np.testing.assert_allclose(got, wanted, rtol=1e-13)
    steps = np.diff(got, prepend=0.0)
    handover = np.flatnonzero(steps < rate * DT * (1 - 1e-9))[0]
    assert 5 < handover < 95
    # From there on the distance shrinks by the same factor in each tick.
    rest = 0.8 - got[handover - 1 :]
    np.testing.assert_allclose(rest[1:] / rest[:-1], np.exp(-DT / tau), rtol=1e-12)


def test_an_absent_limit_equals_one_that_is_out_of_reach():
    commands = np.linspace(-1, 1, 30) ** 3
    plain = _positions(Actuator(0.4), commands)
    loose = _positions(Actuator(0.4, rate_limit=1e9, time_constant=1e-9), commands)
    np.testing.assert_allclose(plain, loose, atol=1e-15)
    assert Actuator(0.4).rate_limit is None
    assert Actuator(0.4).time_constant is None


def test_the_three_actuators_move_independently():
    actuators = Command(
        Actuator(0.4), Actuator(0.06, rate_limit=0.1), Actuator(1.5, time_constant=1.0)
    )
    held, wanted = Command(0.0, 0.0, 0.0), Command(0.3, 0.05, 1.0)
    got = jax.jit(follow_all)(actuators, held, wanted, jnp.asarray(0.1))
    assert float(got.buoyancy_mass) == pytest.approx(0.3)
    assert float(got.mass_position) == pytest.approx(0.01)
    assert float(got.mass_angle) == pytest.approx(1 - np.exp(-0.1))


def test_the_slope_through_an_actuator_is_that_of_its_active_part():
    dt = jnp.asarray(DT)

    def slope(actuator, wanted):
        def final(w):
            return actuator.follow(jnp.asarray(0.0), w, dt)

        return float(jax.grad(final)(jnp.asarray(wanted)))

    assert slope(Actuator(0.4), 0.1) == 1.0
    assert slope(Actuator(0.4), 1.0) == 0.0
    assert slope(Actuator(0.4, rate_limit=0.1), 0.1) == 0.0
    lag = slope(Actuator(0.4, time_constant=0.5), 0.1)
    assert lag == pytest.approx(1 - np.exp(-0.1))


@pytest.mark.parametrize("name", ["limit", "rate_limit", "time_constant"])
@pytest.mark.parametrize("bad", [0.0, -0.4, float("nan")])
def test_numbers_that_are_not_positive_are_refused(name, bad):
    with pytest.raises(ValueError, match=rf"Actuator\.{name} must be (positive|fin)"):
        Actuator(**{"limit": 1.0, name: bad})


@pytest.mark.parametrize("bad", [-0.01, float("nan")])
def test_a_dead_band_below_zero_is_refused(bad):
    with pytest.raises(ValueError, match=r"Actuator\.dead_band must be"):
        Actuator(1.0, dead_band=bad)
