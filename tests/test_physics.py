"""The glider obeys mechanics, and agrees with its equations written a second time."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from jaxglider import Clock, GliderParameters, GliderState, load_vehicle, paper
from jaxglider.signals import BodyAxes, Command
from jaxglider.simulation.motion import integrate
from jaxglider.simulation.tick import TickInput, TickPlan
from jaxglider.vehicle.hydrodynamics import coriolis, hydrodynamics
from jaxglider.vehicle.moving_mass import (
    PrintedActuation,
    RigidBodyActuation,
    restoring,
)
from jaxglider.vehicle.plant import printed_plant, rigid_body_plant

PLANTS = {"printed": printed_plant, "rigid-body": rigid_body_plant}
PARAMETERS = load_vehicle("seawing").parameters
COEFFICIENTS = (
    "drag",
    "lift_offset",
    "lift_slope",
    "side_force_slope",
    "roll_moment_slope",
    "roll_damping",
    "pitch_moment_offset",
    "pitch_moment_slope",
    "pitch_damping",
    "yaw_moment_slope",
    "yaw_damping",
)


def array(container):
    """The fields of a container along a last axis."""
    fields = [getattr(container, f.name) for f in dataclasses.fields(container)]
    return np.stack(np.broadcast_arrays(*fields), axis=-1)


def skew(x):
    return np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])


class MatrixGlider:
    """The paper's glider in NumPy matrices, with its errata put right.

    `rigid_body` replaces the series in the mass angle by the cross product r_p × W.
    """

    def __init__(self, parameters, rigid_body):
        self.c = {k: float(v) for k, v in vars(parameters).items()}
        self.rigid_body = rigid_body
        self.inertia = np.diag(
            [
                self.c[name]
                for name in (
                    "surge_mass",
                    "sway_mass",
                    "heave_mass",
                    "roll_inertia",
                    "pitch_inertia",
                    "yaw_inertia",
                )
            ]
        )

    def rotation(self, phi, theta, psi):
        s, c = np.sin, np.cos
        rx = [[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]]
        ry = [[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]]
        rz = [[c(psi), -s(psi), 0], [s(psi), c(psi), 0], [0, 0, 1]]
        return np.array(rz) @ np.array(ry) @ np.array(rx)

    def euler_map(self, phi, theta):
        s, c, t = np.sin, np.cos, np.tan
        return np.array(
            [
                [1, s(phi) * t(theta), c(phi) * t(theta)],
                [0, c(phi), -s(phi)],
                [0, s(phi) / c(theta), c(phi) / c(theta)],
            ]
        )

    def output_map(self, phi, theta):
        """J of the paper, 3×6: rates of depth, pitch and heading from ν."""
        top = self.rotation(phi, theta, 0.0)[2:]
        return np.block(
            [
                [top, np.zeros((1, 3))],
                [np.zeros((2, 3)), self.euler_map(phi, theta)[1:]],
            ]
        )

    def coriolis(self, nu):
        momentum = self.inertia @ nu
        linear, angular = skew(momentum[:3]), skew(momentum[3:])
        return np.block([[np.zeros((3, 3)), linear], [linear, angular]])

    def damping(self, nu):
        u = abs(nu[0])
        k = self.c
        d = np.zeros((6, 6))
        d[0, 0], d[0, 2] = -k["drag"] * u, k["lift_offset"] * u
        d[1, 1] = (k["side_force_slope"] - k["drag"]) * u
        d[2, 0], d[2, 2] = -k["lift_offset"] * u, -(k["drag"] + k["lift_slope"]) * u
        d[3, 1], d[3, 3] = k["roll_moment_slope"] * u, k["roll_damping"] * u**2
        d[4, 0] = k["pitch_moment_offset"] * nu[0]
        d[4, 2] = k["pitch_moment_slope"] * u
        d[4, 4] = k["pitch_damping"] * u**2
        d[5, 1], d[5, 5] = k["yaw_moment_slope"] * u, k["yaw_damping"] * u**2
        return d

    def down(self, phi, theta):
        """Unit vector of gravity in the body frame."""
        return self.rotation(phi, theta, 0.0).T @ [0, 0, 1]

    def effectiveness(self, phi, theta, gamma):
        """B: the paper's, row 4 turned round for the rigid body."""
        k = self.c
        g, rb = k["gravity"], k["buoyancy_position"]
        weight = k["moving_mass"] * g
        arm = weight * k["mass_offset"]
        e = self.down(phi, theta)
        sine = 1 - gamma**2 / 6 + gamma**4 / 120
        cosine = -gamma / 2 + gamma**3 / 24
        b = np.zeros((6, 3))
        b[:3, 0] = g * e
        b[3:, 0] = g * np.cross([rb, 0, 0], e)
        b[3:, 1] = weight * np.cross([1, 0, 0], e)
        row4 = e[2] * sine - e[1] * cosine
        b[3, 2] = arm * row4 if self.rigid_body else -arm * row4
        b[4, 2] = -arm * np.sin(theta) * cosine
        b[5, 2] = arm * np.sin(theta) * sine
        return b

    def restoring(self, phi, theta):
        arm = self.c["moving_mass"] * self.c["gravity"] * self.c["mass_offset"]
        moment = arm * np.cross([0, 0, 1], self.down(phi, theta))
        return np.concatenate([np.zeros(3), moment])

    def actuation(self, phi, theta, command):
        b = self.effectiveness(phi, theta, command[2])
        if not self.rigid_body:
            return b @ command + self.restoring(phi, theta)
        weight = self.c["moving_mass"] * self.c["gravity"] * self.down(phi, theta)
        moment = np.cross(self.mass_at(command), weight)
        return b[:, 0] * command[0] + np.concatenate([np.zeros(3), moment])

    def mass_at(self, command):
        offset = self.c["mass_offset"]
        return np.array(
            [command[1], offset * np.sin(command[2]), offset * np.cos(command[2])]
        )

    def derivative(self, x, command, disturbance):
        angles, nu = x[3:6], x[6:]
        force = (
            (self.coriolis(nu) + self.damping(nu)) @ nu
            + self.actuation(angles[0], angles[1], command)
            + disturbance
        )
        return np.concatenate(
            [
                self.rotation(*angles) @ nu[:3],
                self.euler_map(*angles[:2]) @ nu[3:],
                np.linalg.solve(self.inertia, force),
            ]
        )

    def integrate(self, x, command, force_start, force_end, duration):
        """One tick by an adaptive method of order eight."""

        def rate(t, x):
            share = t / duration
            force = (1 - share) * force_start + share * force_end
            return self.derivative(x, command, force)

        solution = solve_ivp(
            rate, (0, duration), x, method="DOP853", rtol=1e-12, atol=1e-14
        )
        return solution.y[:, -1]

    def classical_step(self, x, command, force_start, force_end, duration):
        """One tick by one Runge-Kutta step of order four."""
        h, middle = duration, 0.5 * (force_start + force_end)
        k1 = self.derivative(x, command, force_start)
        k2 = self.derivative(x + 0.5 * h * k1, command, middle)
        k3 = self.derivative(x + 0.5 * h * k2, command, middle)
        k4 = self.derivative(x + h * k3, command, force_end)
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def random_states(rng, count):
    """States of realistic size under water, one row each."""
    scale = [50, 50, 50, 0.5, 1.0, 3, 0.2, 0.05, 0.05, 0.1, 0.05, 0.05]
    middle = np.zeros(12)
    middle[[2, 6]] = 60.0, 0.4
    return middle + np.array(scale) * rng.uniform(-1, 1, (count, 12))


def every_way(rng, count):
    """Velocities ahead, astern, sideways and tumbling, one row each."""
    scale = np.array([0.5, 0.5, 0.5, 0.3, 0.3, 0.3])
    return scale * rng.uniform(-1, 1, (count, 6))


def random_commands(rng, count):
    return np.array([0.4, 0.06, np.pi / 2]) * rng.uniform(-1, 1, (count, 3))


def columns(kind, rows):
    return kind(*(jnp.asarray(rows[..., i]) for i in range(rows.shape[-1])))


def without_hydrodynamics(parameters):
    return dataclasses.replace(parameters, **dict.fromkeys(COEFFICIENTS, 0.0))


def one_tick(plant, dt=0.05, substeps=1):
    scenario = dataclasses.replace(
        paper.make_scenario(), plant=plant, clock=Clock(1, dt, substeps)
    )

    def advance(state, command, start, end):
        inputs = TickInput(TickPlan(jnp.asarray(0.0), end, *(None,) * 4), start, None)
        return integrate(scenario, state, command, inputs)

    # In a loop, which compiles fastest.
    return jax.jit(lambda *rows: jax.lax.map(lambda x: advance(*x), rows))


@pytest.mark.parametrize("name", PLANTS)
def test_plant_agrees_with_adaptive_integration_between_ticks(name):
    rng = np.random.default_rng(5)
    count = 12
    # The position of the buoyancy engine is zero as published: here it must count.
    parameters = dataclasses.replace(PARAMETERS, buoyancy_position=0.3)
    states, commands = random_states(rng, count), random_commands(rng, count)
    start, end = (0.05 * rng.uniform(-1, 1, (count, 6)) for _ in range(2))
    arguments = (
        columns(GliderState, states),
        columns(Command, commands),
        columns(BodyAxes, start),
        columns(BodyAxes, end),
    )
    glider = MatrixGlider(parameters, rigid_body=name == "rigid-body")
    expected = np.array(
        [
            glider.integrate(*row, 0.05)
            for row in zip(states, commands, start, end, strict=True)
        ]
    )

    def error(substeps, expected):
        plant = PLANTS[name](parameters)
        return np.abs(array(one_tick(plant, 0.05, substeps)(*arguments)) - expected)

    assert error(8, expected).max() < 1e-8
    single = np.array(
        [
            glider.classical_step(*row, 0.05)
            for row in zip(states, commands, start, end, strict=True)
        ]
    )
    assert error(1, single).max() < 1e-12


def test_coriolis_is_a_skew_matrix_and_does_no_work():
    rng = np.random.default_rng(1)
    glider = MatrixGlider(PARAMETERS, rigid_body=True)
    velocities = random_states(rng, 50)[:, 6:]
    force = array(coriolis(PARAMETERS, columns(BodyAxes, velocities)))
    for nu, found in zip(velocities, force, strict=True):
        matrix = glider.coriolis(nu)
        np.testing.assert_array_equal(matrix, -matrix.T)
        np.testing.assert_allclose(found, matrix @ nu, rtol=1e-12, atol=1e-14)
        assert abs(nu @ found) < 1e-14 * np.linalg.norm(found)


def test_translation_loses_power_to_drag_and_to_nothing_else():
    rng = np.random.default_rng(2)
    velocities = every_way(rng, 200)
    velocities[:, 3:] = 0.0
    force = array(hydrodynamics(PARAMETERS, columns(BodyAxes, velocities)))
    power = np.sum(force * velocities, axis=1)
    u, v, w = velocities.T[:3]
    drag, side, lift = (
        float(getattr(PARAMETERS, name))
        for name in ("drag", "side_force_slope", "lift_slope")
    )
    # The offset of the lift stands across the motion and must not appear.
    lost = drag * (u**2 + v**2 + w**2) - side * v**2 + lift * w**2
    np.testing.assert_allclose(power, -np.abs(u) * lost, rtol=1e-12)
    assert np.all(power < 0.0)


def test_rotation_about_each_axis_is_damped_by_the_square_of_the_speed():
    speed = 0.5
    for axis, name in ((3, "roll"), (4, "pitch"), (5, "yaw")):
        nu = np.zeros(6)
        nu[0], nu[axis] = speed, 0.1
        still = nu.copy()
        still[axis] = 0.0
        moment = array(hydrodynamics(PARAMETERS, columns(BodyAxes, nu)))[axis]
        offset = array(hydrodynamics(PARAMETERS, columns(BodyAxes, still)))[axis]
        damping = float(getattr(PARAMETERS, f"{name}_damping"))
        assert damping < 0.0
        np.testing.assert_allclose(moment - offset, damping * 0.1 * speed**2)


def test_roll_moment_has_no_second_sideslip_term():
    nu = np.array([0.5, 0.02, 0, 0, 0, 0])
    moment = hydrodynamics(PARAMETERS, columns(BodyAxes, nu)).roll
    np.testing.assert_allclose(moment, -58.27 * 0.5 * 0.02, rtol=1e-12)


def energy(glider, x, command):
    """Kinetic energy, and potential energy of moving mass and buoyancy."""
    c, rotation = glider.c, glider.rotation(*x[3:6])
    lowered = (rotation @ glider.mass_at(command))[2]
    buoyancy_depth = x[2] + (rotation @ [c["buoyancy_position"], 0, 0])[2]
    return (
        0.5 * x[6:] @ glider.inertia @ x[6:]
        - c["moving_mass"] * c["gravity"] * lowered
        - command[0] * c["gravity"] * buoyancy_depth
    )


@pytest.mark.parametrize(("name", "conserved"), [("rigid-body", 1), ("printed", 0)])
def test_energy_is_conserved_where_the_moving_mass_obeys_mechanics(name, conserved):
    parameters = dataclasses.replace(
        without_hydrodynamics(PARAMETERS), buoyancy_position=0.3
    )
    rng = np.random.default_rng(3)
    count, ticks = 8, 200
    states, commands = random_states(rng, count), random_commands(rng, count)
    states[:, 3:5] *= 0.4
    advance = one_tick(PLANTS[name](parameters), dt=0.02)
    glider = MatrixGlider(parameters, rigid_body=True)
    calm = columns(BodyAxes, np.zeros((count, 6)))
    held = columns(Command, commands)

    @jax.jit
    def roll_out(state):
        def tick(state, _):
            return advance(state, held, calm, calm), None

        return jax.lax.scan(tick, state, None, length=ticks)[0]

    last = array(roll_out(columns(GliderState, states)))
    before = np.array(
        [energy(glider, *row) for row in zip(states, commands, strict=True)]
    )
    after = np.array([energy(glider, *row) for row in zip(last, commands, strict=True)])
    moved = np.array([x[6:] @ glider.inertia @ x[6:] for x in last])
    change = np.abs(after - before) / moved
    assert np.all(np.abs(last[:, 4]) < 1.4)
    if conserved:
        assert change.max() < 1e-7
    else:
        # The sign printed in row 4 makes energy out of nothing.
        assert change.max() > 1e-2


@pytest.mark.parametrize("gamma", [0.0, 0.4, -1.2])
@pytest.mark.parametrize("offset", [0.0, 0.003])
def test_rigid_body_at_rest_hangs_with_its_roll_equal_to_the_mass_angle(gamma, offset):
    pitch = -np.arctan2(offset, float(PARAMETERS.mass_offset))
    state = GliderState.at_rest(roll=gamma, pitch=pitch)
    calm = columns(BodyAxes, np.zeros(6))
    rate = rigid_body_plant(PARAMETERS).derivative(
        state, Command(0.0, offset, gamma), calm
    )
    np.testing.assert_allclose(array(rate), 0.0, atol=1e-14)


@pytest.mark.parametrize("gamma", [0.0, 0.7])
def test_small_swings_about_the_hang_are_those_of_a_pendulum(gamma):
    plant = rigid_body_plant(PARAMETERS)
    calm = columns(BodyAxes, np.zeros(6))

    def rate(x):
        state = plant.derivative(
            GliderState(*x), Command(0.0, 0.0, jnp.asarray(gamma)), calm
        )
        return jnp.stack([getattr(state, f.name) for f in dataclasses.fields(state)])

    at = jnp.zeros(12).at[3].set(gamma)
    found = np.linalg.eigvals(np.asarray(jax.jit(jax.jacfwd(rate))(at)))
    assert np.abs(found.real).max() < 1e-6
    # Turning the body by a small vector d pulls it back with arm (d − n (n·d)), where n
    # points from the body axis to the mass.
    c = {k: float(v) for k, v in vars(PARAMETERS).items()}
    arm = c["moving_mass"] * c["gravity"] * c["mass_offset"]
    n = np.array([0.0, np.sin(gamma), np.cos(gamma)])
    stiffness = arm * (np.eye(3) - np.outer(n, n))
    inertia = np.diag([c["roll_inertia"], c["pitch_inertia"], c["yaw_inertia"]])
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(inertia, stiffness)).real)
    expected = np.sqrt(squares[-2:])
    swings = np.sort(found.imag[found.imag > 1e-4])
    np.testing.assert_allclose(swings, expected, rtol=1e-9)
    if gamma == 0.0:
        np.testing.assert_allclose(expected[-1], np.sqrt(arm / c["roll_inertia"]))


@pytest.mark.parametrize("family", [PrintedActuation(), RigidBodyActuation()])
def test_weight_of_the_moving_mass_rights_the_glider(family):
    arm = 11.0 * 9.81 * 0.014
    for roll, pitch in ((0.3, 0.0), (-0.3, -0.6), (0.0, 0.5)):
        a = GliderState.at_rest(roll=roll, pitch=pitch).attitude()
        wrench = family.wrench(PARAMETERS, a, Command(0.0, 0.0, 0.0))
        expected = -arm * np.cos(pitch) * np.sin(roll)
        np.testing.assert_allclose(wrench.roll, expected, atol=1e-15)
        np.testing.assert_allclose(wrench.pitch, -arm * np.sin(pitch), atol=1e-15)
        assert float(wrench.roll) * roll <= 0.0


@pytest.mark.parametrize("pitch", [-0.7, 0.7])
def test_yaw_moment_keeps_its_sign_up_to_a_right_angle(pitch):
    # Printed without the sixth, it would turn round at a mass angle of 1.05 rad.
    a = GliderState.at_rest(pitch=pitch).attitude()
    arm = 11.0 * 9.81 * 0.014
    for gamma in (0.1, 1.3, np.pi / 2):
        command = Command(0.0, 0.0, gamma)
        found = PrintedActuation().wrench(PARAMETERS, a, command).yaw
        expected = arm * np.sin(pitch) * np.sin(gamma)
        np.testing.assert_allclose(found, expected, rtol=5e-3)


def test_the_two_families_differ_in_the_sign_of_row_four_alone():
    a = GliderState.at_rest(roll=0.2, pitch=-0.6, heading=1.0).attitude()
    gamma = jnp.asarray(0.9)
    printed = PrintedActuation().effectiveness(PARAMETERS, a, gamma)
    rigid = RigidBodyActuation().effectiveness(PARAMETERS, a, gamma)
    assert float(rigid.roll_angle) > 0.0
    assert float(printed.roll_angle) == -float(rigid.roll_angle)
    for field in dataclasses.fields(printed):
        if field.name != "roll_angle":
            same = (
                float(getattr(printed, field.name)),
                float(getattr(rigid, field.name)),
            )
            assert same[0] == same[1]


def test_moment_of_the_moving_mass_is_the_cross_product():
    rng = np.random.default_rng(4)
    states, commands = random_states(rng, 60), random_commands(rng, 60)
    commands[:, 0] = 0.0
    glider = MatrixGlider(PARAMETERS, rigid_body=True)
    family = RigidBodyActuation()
    arm = 11.0 * 9.81 * 0.014

    def both(state, command):
        a = state.attitude()
        series = family.effectiveness(PARAMETERS, a, command.mass_angle)
        affine = series.wrench(command) + restoring(PARAMETERS, a)
        return family.wrench(PARAMETERS, a, command), affine

    exact, affine = map(
        array,
        jax.jit(jax.vmap(both))(
            columns(GliderState, states), columns(Command, commands)
        ),
    )
    for x, command, whole, series in zip(states, commands, exact, affine, strict=True):
        weight = 11.0 * 9.81 * glider.rotation(*x[3:6]).T @ [0, 0, 1]
        moment = np.cross(glider.mass_at(command), weight)
        np.testing.assert_allclose(whole[3:], moment, atol=1e-13)
        # First terms left out of the series of sine and cosine.
        gamma = abs(command[2])
        sine, cosine = gamma**7 / 5040, gamma**6 / 720
        assert np.all(
            np.abs(series[3:] - moment)
            <= arm * np.array([sine + cosine, cosine, sine]) + 1e-13
        )


@pytest.mark.parametrize(("mass", "position"), [(0.3, 0.02), (-0.35, -0.025)])
def test_glider_settles_into_the_steady_glide_its_equations_have(mass, position):
    k = {name: float(value) for name, value in vars(PARAMETERS).items()}
    g, weight = k["gravity"], k["moving_mass"] * k["gravity"]

    def balance(unknown):
        u, w, theta = unknown
        lift, drag = k["lift_offset"], k["drag"]
        return (
            lift * u * w - drag * u**2 - mass * g * np.sin(theta),
            -lift * u**2 - (drag + k["lift_slope"]) * u * w + mass * g * np.cos(theta),
            (k["heave_mass"] - k["surge_mass"] + k["pitch_moment_slope"]) * u * w
            + k["pitch_moment_offset"] * u**2
            - weight * (k["mass_offset"] * np.sin(theta) + position * np.cos(theta)),
        )

    down = np.sign(mass)
    solution, _, found, message = fsolve(
        balance, (0.4, 0.01 * down, -0.7 * down), xtol=1e-13, full_output=True
    )
    assert found == 1, message
    advance = one_tick(rigid_body_plant(PARAMETERS), dt=0.1)
    held = columns(Command, np.array([[mass, position, 0.0]]))
    calm = columns(BodyAxes, np.zeros((1, 6)))

    @jax.jit
    def roll_out(state):
        def tick(state, _):
            return advance(state, held, calm, calm), None

        return jax.lax.scan(tick, state, None, length=6000)[0]

    start = np.zeros((1, 12))
    # Deep enough to climb for ten minutes and stay below the surface.
    start[0, [2, 4, 6]] = 1000.0, -0.3 * down, 0.2
    last = array(roll_out(columns(GliderState, start)))[0]
    np.testing.assert_allclose(last[[6, 8, 4]], solution, rtol=1e-7)
    np.testing.assert_allclose(last[[3, 7, 9, 10, 11]], 0.0, atol=1e-9)


def test_parameters_used_here_are_the_published_ones():
    assert isinstance(PARAMETERS, GliderParameters)
    assert array(PARAMETERS.inertia()).tolist() == [
        66.76,
        114.86,
        131.20,
        1.13,
        23.15,
        25.50,
    ]
    assert [float(getattr(PARAMETERS, name)) for name in COEFFICIENTS] == [
        7.19,
        -0.36,
        440.99,
        -115.65,
        -58.27,
        -19.83,
        0.28,
        -65.84,
        -205.64,
        34.10,
        -389.30,
    ]
