"""Steady motions against published ones, closed forms and finite differences."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import angle_of_attack, straight_glide
from scipy.linalg import expm

from jaxglider import load_vehicle, paper
from jaxglider.signals import BodyAxes, Command
from jaxglider.signals import zeros as calm
from jaxglider.trim.linear_model import INPUTS, STATES, linearise
from jaxglider.trim.modes import analyse, transmission_zeros, zero_dynamics
from jaxglider.trim.steady_motion import SteadyMotion, Target, steady_motion
from jaxglider.trim.straight_glide import glide_limits, glide_polar
from jaxglider.vehicle.full_plant import full_plant
from jaxglider.vehicle.published import vehicle_names

VEHICLES = {name: load_vehicle(name) for name in vehicle_names()}
PLANTS = {name: full_plant(vehicle) for name, vehicle in VEHICLES.items()}
SEAWING = PLANTS["seawing"]
SPIRAL = Command(0.3, 0.4216 - 0.4016, -np.pi / 4)

solve = jax.jit(steady_motion)
linearise_jit = jax.jit(linearise)


def spiral(plant=SEAWING, command=SPIRAL):
    return solve(plant, Target.of_command(command))


def published(motion):
    """The numbers of a spiral as Zhang et al. 2013 print them."""
    return [
        float(motion.speed()),
        *(
            np.degrees(float(x))
            for x in (
                motion.angle_of_attack(),
                motion.sideslip(),
                motion.state.pitch,
                motion.state.roll,
            )
        ),
    ]


def test_the_published_spiral():
    motion = spiral()
    assert bool(motion.converged)
    expected = [0.490, 1.267, -1.283, -35.641, -13.703]
    np.testing.assert_allclose(published(motion), expected, rtol=0.006)
    assert float(motion.turn_rate) == pytest.approx(0.0039, rel=0.02)


@pytest.mark.parametrize("name", ["yaw_moment_slope", "pitch_moment_offset"])
def test_a_slip_of_sign_would_be_seen_in_the_spiral(name):
    """The tolerance of the test above tells K_MY and K_M0 from their opposites."""
    parameters = dataclasses.replace(
        SEAWING.parameters, **{name: -getattr(SEAWING.parameters, name)}
    )
    motion = spiral(dataclasses.replace(SEAWING, parameters=parameters))
    expected = np.array([0.490, 1.267, -1.283, -35.641, -13.703])
    off = np.abs(np.array(published(motion)) / expected - 1.0).max()
    assert off > 0.05


@pytest.mark.parametrize(
    ("name", "angle", "speed", "alpha", "pitch"),
    [
        ("rogue", -30.0, 0.30, 6.3, -23.7),
        ("rogue", -45.0, 0.37, 3.5, -41.5),
        ("slocum-graver", -25.0, 0.30, 2.02, -22.98),
    ],
)
def test_published_straight_glides(name, angle, speed, alpha, pitch):
    state, command = straight_glide(PLANTS[name], np.radians(angle), speed)
    found = np.degrees(float(jnp.arctan2(state.heave, state.surge)))
    assert found == pytest.approx(alpha, abs=0.06 if name == "rogue" else 0.006)
    assert np.degrees(float(state.pitch)) == pytest.approx(pitch, abs=0.06)
    if name == "slocum-graver":
        # Published with the neutral kilogram: 1.047 kg.
        assert float(command.buoyancy_mass) == pytest.approx(0.047, abs=0.0005)
        assert float(command.mass_position) == pytest.approx(0.0198, abs=0.00005)


@jax.jit
def gliding(plant, angles, speed):
    """Rates and states of straight glides, in a loop, which compiles fastest."""

    def rate(angle):
        state, command = straight_glide(plant, angle, speed)
        return plant.derivative(state, command, calm(BodyAxes)), state

    return jax.lax.map(rate, angles)


@pytest.mark.parametrize("name", PLANTS)
def test_closed_form_is_steady_over_its_whole_range(name):
    plant = PLANTS[name]
    dive, climb = (float(x) for x in glide_limits(plant))
    steep = np.radians(85.0)
    angles = np.concatenate(
        [
            np.linspace(-steep, dive * (1.0 + 1e-9), 30),
            np.linspace(climb * (1.0 + 1e-9), steep, 30),
        ]
    )

    rates, states = gliding(plant, jnp.asarray(angles), 0.35)
    for field in ("surge", "heave", "pitch", "roll", "sway", "pitch_rate", "yaw_rate"):
        np.testing.assert_allclose(getattr(rates, field), 0.0, atol=1e-9)
    path = np.arctan2(-rates.depth, rates.north)
    np.testing.assert_allclose(path, angles, atol=1e-9)
    speed = np.hypot(states.surge, states.heave)
    np.testing.assert_allclose(speed, 0.35)
    # Beyond its ends there is none, and the ends are where lift over drag is greatest.
    for inside in (0.999 * dive, 0.5 * climb):
        assert np.isnan(float(angle_of_attack(plant, inside)))
    c = plant.parameters
    alpha = np.radians(np.linspace(0.01, 30.0, 40000))
    for sense, limit in ((1.0, dive), (-1.0, climb)):
        lift = float(c.lift_offset) + float(c.lift_slope) * sense * alpha
        drag = float(c.drag) + float(plant.body.induced_drag) * alpha**2
        best = np.max(sense * lift / drag)
        assert abs(np.tan(limit)) == pytest.approx(1.0 / best, rel=1e-6)


def wanted(angle, speed, turn_rate):
    """One by one: the command line's program does for it."""
    target = Target(glide_angle=angle, speed=speed, turn_rate=turn_rate)
    return solve(SEAWING, target)


def test_commands_for_a_wanted_path_and_the_limits_of_it():
    """Straight: the closed form. Too shallow: flagged. Turning: the spiral again."""
    turning = spiral()
    angles = np.radians([-80.0, -40.0, -14.0, -13.0, -3.0, 14.0, 60.0])
    angles = np.append(angles, float(turning.glide_angle()))
    speeds = np.append(np.full(7, 0.4), float(turning.speed()))
    rates = np.append(np.zeros(7), float(turning.turn_rate))
    found = [wanted(*given) for given in zip(angles, speeds, rates, strict=True)]
    found = jax.tree.map(lambda *x: np.stack(x), *found)
    np.testing.assert_array_equal(found.converged, [1, 1, 1, 0, 0, 1, 1, 1])
    straight = np.array([0, 1, 2, 5, 6])
    state, command = jax.jit(jax.vmap(lambda a: straight_glide(SEAWING, a, 0.4)))(
        jnp.asarray(angles[straight])
    )
    for name in ("surge", "heave", "pitch"):
        np.testing.assert_allclose(
            getattr(found.state, name)[straight], getattr(state, name), atol=1e-9
        )
    for name in INPUTS:
        np.testing.assert_allclose(
            getattr(found.command, name)[straight], getattr(command, name), atol=1e-8
        )
        assert float(getattr(found.command, name)[7]) == pytest.approx(
            float(getattr(SPIRAL, name)), rel=1e-6
        )


def test_a_trim_can_be_differentiated():
    """By mass and by the coefficient that turns the glider, against differences."""

    def changed(buoyancy, slope):
        parameters = dataclasses.replace(SEAWING.parameters, yaw_moment_slope=slope)
        command = dataclasses.replace(SPIRAL, buoyancy_mass=buoyancy)
        plant = dataclasses.replace(SEAWING, parameters=parameters)
        return plant, Target.of_command(command)

    at = jnp.asarray(0.3), SEAWING.parameters.yaw_moment_slope
    slopes = jax.jit(
        jax.grad(lambda *x: steady_motion(*changed(*x)).turn_rate, (0, 1))
    )(*at)
    for n, step in ((0, 1e-3), (1, 1e-2)):
        up, down = (
            solve(*changed(*(x + sign * step * (n == i) for i, x in enumerate(at))))
            for sign in (1, -1)
        )
        expected = float(up.turn_rate - down.turn_rate) / (2 * step)
        assert float(slopes[n]) == pytest.approx(expected, rel=1e-4)


def test_polar_agrees_with_trims_of_every_plant():
    """The small-angle plants leave the induced drag out, and glide a little steeper."""
    for name, make in paper.PLANTS.items():
        plant = make(VEHICLES["seawing"])
        for mass, alpha in ((0.3, 0.02), (-0.2, -0.03)):
            angle, speed = glide_polar(plant, mass, jnp.asarray(alpha))
            assert float(angle) * mass < 0.0
            if name != "seawing":
                continue
            assert float(angle_of_attack(plant, angle)) == pytest.approx(alpha)
            held = straight_glide(plant, angle, speed)[1].buoyancy_mass
            assert float(held) == pytest.approx(mass)
    assert np.isnan(float(glide_polar(SEAWING, 0.3, jnp.asarray(-0.1))[0]))


def test_linearisation_foretells_a_small_step():
    """Against the nonlinear plant two seconds later, and differences of B."""
    motion = spiral()
    linear = linearise_jit(SEAWING, motion)
    rng = np.random.default_rng(2)
    small = 1e-5 * rng.uniform(-1, 1, 10)

    @jax.jit
    def ahead(at, commands):
        def rate(given):
            x, command = given
            state = dataclasses.replace(
                motion.state, **dict(zip(STATES, x, strict=True))
            )
            rate = SEAWING.derivative(state, Command(*command), calm(BodyAxes))
            return jnp.stack([getattr(rate, name) for name in STATES])

        return jax.lax.map(rate, (at, commands))

    at = np.stack([getattr(motion.state, name) for name in STATES])
    held = np.stack([getattr(motion.command, name) for name in INPUTS])
    pushes = 1e-5 * np.eye(3)
    found = ahead(
        np.stack([at + small, at - small, *[at] * 6]),
        np.stack([held, held, *(held + pushes), *(held - pushes)]),
    )
    np.testing.assert_allclose((found[0] - found[1]) / 2, linear.a @ small, atol=1e-9)
    difference = np.asarray(found[2:5] - found[5:]).T
    np.testing.assert_allclose(difference / 2e-5, linear.b, atol=1e-6)


def test_modes_reach_and_rank():
    """Of a system whose answer is known, in the glider's states."""
    a = np.zeros((10, 10))
    order = {name: i for i, name in enumerate(STATES)}
    for name, rate in (("surge", -0.1), ("sway", -0.5), ("heave", -2.0)):
        a[order[name], order[name]] = rate
    for name, rate in (("roll", "roll_rate"), ("pitch", "pitch_rate")):
        a[order[name], order[rate]] = 1.0
        a[order[rate], order[name]], a[order[rate], order[rate]] = -4.0, -0.4
    a[order["heading"], order["yaw_rate"]] = a[order["depth"], order["heave"]] = 1.0
    a[order["yaw_rate"], order["yaw_rate"]] = -3.0
    b = np.zeros((10, 3))
    b[order["surge"], 0] = b[order["heave"], 0] = 2.0
    b[order["pitch_rate"], 1], b[order["roll_rate"], 2] = 3.0, 5.0
    b[order["yaw_rate"], 2] = 1.0
    found = analyse(a, b, np.array([0.5, 1.0, 1.0]))
    slow, first, second, *_ = found.modes
    assert slow.eigenvalue == pytest.approx(-0.1)
    assert slow.reach == pytest.approx((1.0, 0.0, 0.0))
    assert slow.time_constant() == pytest.approx(10.0)
    assert first.period() == pytest.approx(2 * np.pi / np.sqrt(4.0 - 0.04))
    assert {round(first.lateral), round(second.lateral)} == {0, 1}
    assert found.stable()
    assert (found.rank, found.order) == (9, 10)  # nothing pushes the sway


@pytest.mark.parametrize("plant", paper.PLANTS)
def test_zero_dynamics_are_what_is_left_when_the_outputs_are_held(plant):
    """The zeros are the rates at which the held glider really settles.

    They are slow, and swing, where the moving mass obeys mechanics.
    """
    glider = paper.PLANTS[plant](VEHICLES["seawing"])
    state, command = straight_glide(SEAWING, np.radians(-35.0), 0.4)
    # The small-angle glider balances with the mass elsewhere.
    placed = [
        dataclasses.replace(command, mass_position=jnp.asarray(x)) for x in (0.0, 0.01)
    ]
    turn = [glider.derivative(state, c, calm(BodyAxes)).pitch_rate for c in placed]
    balance = 0.01 * turn[0] / (turn[0] - turn[1])
    command = dataclasses.replace(command, mass_position=balance)
    motion = SteadyMotion(
        state, command, 0.0 * state.surge, 0.0 * state.surge, jnp.asarray(True)
    )
    a, b = (np.asarray(x) for x in linearise_jit(glider, motion))
    found = transmission_zeros(a, b)
    assert len(found) == 4
    if plant == "printed":
        assert found[0].real < -0.5
    else:
        assert -0.3 < found[0].real < -0.2
        assert abs(found[0].imag) > 0.2
    start = np.zeros(10)
    start[STATES.index("roll")] = 0.1
    times = np.linspace(0.0, 30.0, 301)
    held = zero_dynamics(a, b, start, times)
    for name in ("depth", "pitch", "heading"):
        np.testing.assert_allclose(held[:, STATES.index(name)], 0.0, atol=1e-9)
    size = np.linalg.norm(held, axis=1)
    assert size[-1] < size[0] * np.exp(found[0].real * 30.0) * 50.0
    values = np.linalg.eigvals(
        a - b @ np.linalg.solve((c := _outputs()) @ a @ b, c @ a @ a)
    )
    for zero in found:
        assert np.abs(values - zero).min() < 1e-6
    np.testing.assert_allclose(
        held[1], expm(0.1 * (a - b @ np.linalg.solve(c @ a @ b, c @ a @ a))) @ held[0]
    )


def _outputs():
    return np.eye(10)[[STATES.index(name) for name in ("depth", "pitch", "heading")]]


def test_trim_prints_draws_and_writes(call, tmp_path):
    code, out, err = call("trim", "--mass-angle", -45, "--out", "o", "--json")
    assert code == 0, err
    result = json.loads(out)
    assert result["motion"]["pitch_deg"] == pytest.approx(-35.641, rel=0.006)
    assert result["analysis"]["controllable"]
    assert result["shallowest_glide_deg"]["dive"] == pytest.approx(-13.52, abs=0.01)
    assert (tmp_path / "o" / "trim.png").stat().st_size > 10_000
    assert json.loads((tmp_path / "o" / "trim.json").read_text()) == result


@pytest.mark.parametrize(
    ("arguments", "code", "parts"),
    [
        ("--glide-angle -5 --speed 0.4", 2, ("-5 deg", "shallowest dive", "-13.52")),
        ("--glide-angle 30 --buoyancy-mass 0.3", 2, ("a climb the opposite",)),
        (
            "--glide-angle -35 --speed 0.9 --turn-rate 0",
            3,
            ("buoyancy_mass is beyond",),
        ),
        ("--glide-angle 0", 2, ("--glide-angle", "'0'")),
        ("--speed 0", 2, ("--speed", "positive number")),
        ("--speed 1 --buoyancy-mass 1", 2, ("not allowed with",)),
        ("--vehicle spray", 2, ("vehicle must be one of", "'spray'")),
        ("--vehicle no.toml", 2, ("--vehicle no.toml cannot be read",)),
        ("--buoyancy-mass 0", 2, ("no steady glide without buoyancy",)),
    ],
)
def test_trim_says_what_cannot_be(call, arguments, code, parts):
    got, _, err = call("trim", *arguments.split())
    assert got == code, err
    for part in parts:
        assert part in err


def test_vehicles_are_listed_and_shown(call, tmp_path):
    code, out, _ = call("vehicles", "--json")
    assert code == 0
    found = json.loads(out)
    assert set(found) == {
        "rogue",
        "seaglider",
        "seawing",
        "slocum",
        "slocum-comet",
        "slocum-graver",
    }
    assert found["rogue"]["displaced_mass_kg"] == pytest.approx(11.22)
    assert "parameters.side_force_slope" in found["rogue"]["doubts"]
    _, out, _ = call("vehicles")
    assert "slocum" in out
    _, text, _ = call("vehicles", "--show", "slocum")
    (tmp_path / "mine.toml").write_text(text)
    mine = load_vehicle(tmp_path / "mine.toml")
    assert float(mine.parameters.drag) == 7.8
    assert call("vehicles", "--show", "spray")[0] == 2


def test_a_target_needs_one_of_each_pair():
    with pytest.raises(ValueError, match="exactly one of buoyancy_mass, speed"):
        Target(glide_angle=-0.5, mass_angle=0.0)
    with pytest.raises(ValueError, match="received mass_angle and turn_rate"):
        Target(speed=0.3, glide_angle=-0.5, mass_angle=0.0, turn_rate=0.1)
