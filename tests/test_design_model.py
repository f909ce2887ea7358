"""f, g and h of the design model are what the equations of motion make of them."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_physics import MatrixGlider, array, columns, random_commands, random_states

from jaxglider.core import rotations as frames
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    output_rates,
)
from jaxglider.vehicle.design_model import DesignModel, InputGain, _frame_acceleration
from jaxglider.vehicle.moving_mass import PrintedActuation, RigidBodyActuation
from jaxglider.vehicle.published import load_vehicle

PARAMETERS = dataclasses.replace(
    load_vehicle("seawing").parameters, buoyancy_position=0.3
)
FAMILIES = {"printed": PrintedActuation(), "rigid-body": RigidBodyActuation()}


def measure(state, applied, disturbance):
    return Measurement(state, state.attitude(), applied, disturbance)


def matrix(gain):
    """g as a matrix: outputs down, inputs across."""
    zero = jnp.zeros_like(gain.depth_buoyancy)
    rows = (
        (gain.depth_buoyancy, zero, zero),
        (gain.pitch_buoyancy, gain.pitch_position, gain.pitch_angle),
        (gain.heading_buoyancy, gain.heading_position, gain.heading_angle),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@pytest.fixture(scope="module")
def parts():
    """Drift, input gain and force of a design model for many measurements at once."""

    def parts(model, state, applied, disturbance):
        m = measure(state, applied, disturbance)
        force = model.force(state, m.attitude, applied)
        return model.drift(m), model.input_gain(m), force

    # In a loop, which compiles fastest.
    return jax.jit(lambda model, *rows: jax.lax.map(lambda x: parts(model, *x), rows))


def sample(seed, count=12, largest_angle=1.5):
    rng = np.random.default_rng(seed)
    states, commands = random_states(rng, count), random_commands(rng, count)
    states[:, 2] *= 0.02
    commands[:, 2] *= largest_angle / (np.pi / 2)
    return states, commands, 0.05 * rng.uniform(-1, 1, (count, 6))


def second_derivative(glider, x, command, disturbance, step=0.02):
    """η'' from a central difference of order six along the exact motion."""

    def output_at(time):
        if time == 0.0:
            return x[[2, 4, 5]]
        solution = solve_ivp(
            lambda _, y: glider.derivative(y, command, disturbance),
            (0.0, time),
            x,
            method="DOP853",
            rtol=1e-13,
            atol=1e-15,
        )
        return solution.y[[2, 4, 5], -1]

    weights = np.array([2, -27, 270, -490, 270, -27, 2]) / 180
    return (
        sum(w * output_at(n * step) for n, w in zip(range(-3, 4), weights, strict=True))
        / step**2
    )


@pytest.mark.parametrize(
    # The control-affine form of the rigid body is a series in the mass angle.
    ("family", "largest_angle"),
    [("printed", 1.5), ("rigid-body", 0.2)],
)
def test_true_motion_accelerates_as_a_true_design_model_says(
    parts, family, largest_angle
):
    states, commands, forces = sample(11, largest_angle=largest_angle)
    drift, gain, _ = parts(
        DesignModel(PARAMETERS, FAMILIES[family]),
        columns(GliderState, states),
        columns(Command, commands),
        columns(BodyAxes, forces),
    )
    predicted = array(drift) + np.einsum("nij,nj->ni", matrix(gain), commands)
    glider = MatrixGlider(PARAMETERS, rigid_body=family == "rigid-body")
    moved = np.array(
        [
            second_derivative(glider, *row)
            for row in zip(states, commands, forces, strict=True)
        ]
    )
    np.testing.assert_allclose(predicted, moved, rtol=1e-6, atol=3e-7)


@pytest.mark.parametrize("family", FAMILIES)
def test_parts_of_the_design_model_are_the_products_of_matrices(parts, family):
    states, commands, forces = sample(12)
    model = DesignModel(PARAMETERS, FAMILIES[family])
    inputs = columns(GliderState, states), columns(Command, commands)
    drift, gain, force = parts(model, *inputs, columns(BodyAxes, forces))
    undisturbed, _, _ = parts(model, *inputs, columns(BodyAxes, 0 * forces))
    glider = MatrixGlider(PARAMETERS, rigid_body=family == "rigid-body")
    for n, (x, command) in enumerate(zip(states, commands, strict=True)):
        phi, theta, nu = x[3], x[4], x[6:]
        h = glider.output_map(phi, theta) @ np.linalg.inv(glider.inertia)
        b = glider.effectiveness(phi, theta, command[2])
        free = (glider.coriolis(nu) + glider.damping(nu)) @ nu
        free += glider.restoring(phi, theta)
        np.testing.assert_allclose(matrix(gain)[n], h @ b, rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(array(force)[n], free + b @ command, atol=1e-12)
        np.testing.assert_allclose(
            (array(drift) - array(undisturbed))[n], h @ forces[n], atol=1e-13
        )


def test_turning_of_the_frame_is_the_derivative_of_the_output_map():
    states, _, _ = sample(13)

    def by_differentiation(state):
        a = state.attitude()
        rates = frames.euler_rates(a, state.roll_rate, state.pitch_rate, state.yaw_rate)

        def outputs(*angles):
            turned = dataclasses.replace(
                state, **dict(zip(("roll", "pitch", "heading"), angles, strict=True))
            )
            zero = Command(0.0, 0.0, 0.0)
            return output_rates(measure(turned, zero, state.velocity()))

        angles = state.roll, state.pitch, state.heading
        return jax.jvp(outputs, angles, rates)[1]

    def both(state):
        return by_differentiation(state), _frame_acceleration(state, state.attitude())

    expected, found = jax.jit(jax.vmap(both))(columns(GliderState, states))
    np.testing.assert_allclose(array(found), array(expected), rtol=1e-12, atol=1e-15)


def test_solve_is_damped_least_squares():
    rng = np.random.default_rng(14)
    gains = rng.uniform(-1, 1, (20, 7)) * 10.0 ** rng.integers(-2, 1, (20, 7))
    demands = rng.uniform(-1, 1, (20, 3))
    dampings = 10.0 ** rng.uniform(-4, -1, (20, 3))

    def solve(gain, demand, damping):
        gain = InputGain(*gain)
        command = gain.solve(Channels(*demand), Command(*damping))
        return gain, jnp.stack(list(vars(command).values()))

    rows, found = jax.jit(jax.vmap(solve))(gains, demands, dampings)
    for row, demand, damping, command in zip(
        matrix(rows), demands, dampings, found, strict=True
    ):
        tall = np.vstack([row, np.diag(np.sqrt(damping))])
        expected = np.linalg.lstsq(tall, np.append(demand, np.zeros(3)), rcond=None)[0]
        np.testing.assert_allclose(command, expected, rtol=1e-8, atol=1e-10)


def test_level_start_has_no_way_to_turn_yet_its_command_and_gradient_are_finite():
    model = DesignModel(PARAMETERS, PrintedActuation())
    level = GliderState.at_rest(surge=0.1)
    still = columns(BodyAxes, np.zeros(6))
    demand = jnp.array([1e-3, 1e-2, 0.5])
    damping = Command(1e-4, 1e-4, 1e-4)

    def command(pitch, demand):
        state = dataclasses.replace(level, pitch=pitch)
        gain = model.input_gain(measure(state, Command(0.0, 0.0, 0.0), still))
        solved = gain.solve(Channels(*demand), damping)
        return jnp.stack(list(vars(solved).values())), gain

    solve = jax.jit(command)
    solved, gain = solve(0.0, demand)
    g = matrix(gain)
    assert np.linalg.matrix_rank(g) == 2
    expected = np.linalg.solve(g.T @ g + 1e-4 * np.eye(3), g.T @ np.asarray(demand))
    np.testing.assert_allclose(solved, expected, rtol=1e-9, atol=1e-15)
    # The heading is out of reach: its command stays at zero, however large the demand.
    assert float(solved[2]) == 0.0

    jacobian = jax.jit(jax.jacfwd(lambda p: command(p, demand)[0]))(0.0)
    h = 1e-6
    slope = (solve(h, demand)[0] - solve(-h, demand)[0]) / (2 * h)
    np.testing.assert_allclose(jacobian, slope, rtol=1e-5, atol=1e-6)
