"""Steering by bank agrees with Newton's laws, and holds what inversion loses."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_physics import MatrixGlider, random_states

from jaxglider import BankSteering, BodyAxes, Channels, Command, GliderState, paper
from jaxglider.control import ChannelGains, FxTPPC
from jaxglider.control.steering import Asked
from jaxglider.control.turning import turn_model
from jaxglider.signals import Measurement, zeros
from jaxglider.trim.steady_motion import Target, steady_motion
from jaxglider.vehicle.full_plant import full_plant
from jaxglider.vehicle.plant import rigid_body_plant
from jaxglider.vehicle.published import load_vehicle

VEHICLE = load_vehicle("seawing")
PLANT = rigid_body_plant(VEHICLE.parameters)
MODEL = PLANT.model()
INERTIA = MatrixGlider(VEHICLE.parameters, rigid_body=True).inertia[3:, 3:]
STATES = random_states(np.random.default_rng(4), 8)
STEERING = BankSteering(bank_gain=0.6, roll_damping=1.2)


def measured(state, command=None):
    held = zeros(Command, state.surge) if command is None else command
    return Measurement(state, state.attitude(), held, zeros(BodyAxes, state.surge))


def state_of(row):
    return GliderState(*(jnp.asarray(x) for x in row))


def command_of(*numbers):
    return Command(*(jnp.asarray(float(x)) for x in numbers))


@pytest.mark.parametrize("row", STATES)
def test_turn_rate_is_momentum_over_inertia_about_the_vertical(row):
    rotation = MatrixGlider(VEHICLE.parameters, True).rotation(*row[3:6])
    down = rotation[2]
    expected = (rotation @ INERTIA @ row[9:])[2] / (down @ INERTIA @ down)
    turn = turn_model(MODEL, measured(state_of(row)))
    assert float(turn.rate) == pytest.approx(expected, rel=1e-12)


def test_moving_mass_does_not_turn_the_glider_at_once():
    """dΩ/dt by the plant's own equations is the same for any place of the mass."""
    state = state_of(STATES[0])

    @jax.jit
    def growth(command):
        slope = PLANT.derivative(state, command, zeros(BodyAxes, state.surge))
        return jax.jvp(
            lambda s: turn_model(MODEL, measured(s)).rate, (state,), (slope,)
        )[1]

    moved = float(growth(command_of(0.1, 0.05, 1.2)))
    assert moved == pytest.approx(float(growth(command_of(0.1, 0, 0))), rel=1e-10)
    assert abs(moved) > 1e-6


@pytest.mark.parametrize(("angle", "speed"), [(-26.0, 0.228), (26.0, 0.228)])
def test_response_and_damping_are_those_of_the_linearised_glider(angle, speed):
    """Of v' and Ω' by differences, with the bank as input and the roll held."""
    wanted = Target(speed=speed, glide_angle=math.radians(angle), turn_rate=0.0)
    motion = jax.jit(steady_motion)(PLANT, wanted)
    base = motion.state
    rate = jax.jit(
        lambda s: PLANT.derivative(s, motion.command, zeros(BodyAxes, s.surge))
    )
    turn = jax.jit(lambda s: turn_model(MODEL, measured(s)).rate)
    slope = jax.jit(
        lambda s, d: jax.jvp(lambda x: turn_model(MODEL, measured(x)).rate, (s,), (d,))
    )

    def moved(name, by):
        """Sway, or bank, or a turn at constant bank, a little off."""
        if name != "turn":
            return dataclasses.replace(base, **{name: getattr(base, name) + by})
        pitch = float(base.pitch)
        return dataclasses.replace(
            base,
            roll_rate=jnp.asarray(-by * math.sin(pitch)),
            yaw_rate=jnp.asarray(by * math.cos(pitch)),
        )

    def column(name):
        step = 1e-6
        ends = []
        for sign in (1.0, -1.0):
            state = moved(name, sign * step)
            growth = rate(state)
            ends.append(np.array([float(growth.sway), float(slope(state, growth)[1])]))
        return (ends[0] - ends[1]) / (2.0 * step)

    a = np.stack([column("sway"), column("turn")], axis=1)
    b = column("roll")
    assert float(turn(moved("turn", 1e-3))) == pytest.approx(1e-3, rel=1e-9)
    # The transfer from bank to turn is N/(s^2 + T s + D) but for a term in s.
    response = np.linalg.det(a) * (-np.linalg.solve(a, b))[1]
    model = turn_model(MODEL, measured(base, motion.command))
    assert float(model.damping) == pytest.approx(-np.trace(a), rel=0.02)
    assert float(model.response) == pytest.approx(response, rel=0.02)
    assert float(model.response) < 0.0


def test_mass_angle_holds_a_bank_against_the_weight_of_the_hull():
    """At rest, m_p R_p sin(γ − φ) = m_h z_h sin φ."""
    model = full_plant(VEHICLE).model()
    still = GliderState.at_rest(roll=0.3, pitch=-0.5)
    angle = STEERING._mass_angle(model, measured(still), jnp.asarray(0.3))
    moving = float(model.parameters.moving_mass * model.parameters.mass_offset)
    hull = float(model.actuation.hull_moment)
    exact = 0.3 + math.asin(hull / moving * math.sin(0.3))
    # The sine of γ − φ is taken for its angle.
    assert float(angle) == pytest.approx(exact, rel=0.02)
    assert exact > 0.6


def test_nothing_is_short_where_all_that_was_asked_for_was_done():
    state = dataclasses.replace(state_of(STATES[1]), roll=jnp.asarray(0.3))
    held = command_of(0.1, 0.01, 0.4)
    turn = turn_model(MODEL, measured(state, held))
    asked = 0.3 * float(turn.response / turn.damping)
    none = STEERING.shortfall(
        MODEL, measured(state, held), Asked(held, jnp.asarray(asked))
    )
    assert abs(float(none.depth)) + abs(float(none.pitch)) < 1e-15
    assert float(none.heading) == pytest.approx(0.0, abs=1e-15)
    more = STEERING.shortfall(
        MODEL, measured(state, held), Asked(held, jnp.asarray(2.0 * asked))
    )
    assert float(more.heading) == pytest.approx(-asked, rel=1e-9)


def test_bank_stays_within_its_limit_and_depth_and_pitch_get_what_they_ask_for():
    state = state_of(STATES[2])
    seen = measured(state, command_of(0.05, 0.0, 0.1))
    demand = Channels(jnp.asarray(0.01), jnp.asarray(0.02), jnp.asarray(50.0))
    small = command_of(1e-12, 1e-12, 1e-12)
    command = STEERING.command(MODEL, seen, demand, small)
    largest = STEERING._mass_angle(MODEL, seen, STEERING.largest_bank)
    smallest = STEERING._mass_angle(MODEL, seen, -STEERING.largest_bank)
    assert float(command.mass_angle) in (float(largest), float(smallest))
    reached = MODEL.input_gain(seen).response(command)
    drift = MODEL.drift(seen)
    assert float(reached.depth + drift.depth) == pytest.approx(0.01, rel=1e-6)
    assert float(reached.pitch + drift.pitch) == pytest.approx(0.02, rel=1e-6)


@pytest.mark.parametrize("hedging", [None, 1.0])
def test_a_hedged_integral_does_not_wind_up_while_the_bank_is_at_its_limit(hedging):
    """A glider that stays off its heading, with all the bank there is, for long."""
    law = FxTPPC(
        MODEL,
        paper.funnel("switching"),
        Channels(*(ChannelGains(0.001, 0.05),) * 3),
        steering=STEERING,
        hedging=hedging,
    )
    state = dataclasses.replace(state_of(STATES[3]), heading=jnp.asarray(1.1))
    seen = measured(state, command_of(0.05, 0.0, 0.1))
    path = paper.reference("switching")
    planned = jax.tree.map(lambda x: x[0], path.plan(jnp.asarray([150.0])))
    reference, _ = path.step(None, planned, seen, jnp.asarray(0.05))
    bounds = law.bounds(reference.clock)

    def tick(memory, _):
        _, memory, _ = law.step(memory, seen, reference, bounds, jnp.asarray(0.05))
        return memory, memory.integral.heading

    integral = jax.jit(lambda: jax.lax.scan(tick, law.init(), length=8000)[1])()
    half, whole = float(integral[3999]), float(integral[7999])
    if hedging is None:
        assert whole == pytest.approx(2.0 * half, rel=1e-6)
    else:
        assert whole == pytest.approx(half, rel=1e-3)
