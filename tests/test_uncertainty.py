"""Members: what differs, how far, and that nothing else does."""

import dataclasses
import tomllib

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from jaxglider import paper
from jaxglider.core.batching import member_keys
from jaxglider.core.toml import ConfigError
from jaxglider.environment.disturbances import Constant, Sum, axes
from jaxglider.files.uncertainty import TEMPLATE, build_uncertainty, load_uncertainty
from jaxglider.uncertainty.distributions import Uniform
from jaxglider.uncertainty.members import (
    Group,
    Quantity,
    Uncertainty,
    look_up,
    with_member,
)
from jaxglider.uncertainty.quantities import relative, uniform_uncertainty
from jaxglider.uncertainty.sampling import MonteCarlo
from jaxglider.vehicle.actuators import NEVER
from jaxglider.vehicle.parameters import UNCERTAIN

LOOP = paper.make_loop("switching", "rigid-body", duration=5.0)
SCENARIO = LOOP.scenario
PLAIN = tomllib.loads(TEMPLATE())


def rows_of(uncertainty, count, seed=0):
    return uncertainty.values(MonteCarlo(seed, uncertainty.names()).rows(0, count))


def columns_of(uncertainty, count, seed=0):
    return dict(
        zip(uncertainty.names(), rows_of(uncertainty, count, seed).T, strict=True)
    )


def test_the_papers_uncertainty_covers_what_it_says_and_fills_it():
    found = columns_of(uniform_uncertainty(SCENARIO, 0.3, 0.4, 2.0), 4000)
    parameters = SCENARIO.plant.parameters
    for name in UNCERTAIN:
        share = (found[name] / float(getattr(parameters, name)) - 1.0) / 0.3
        # The chance that 4000 draws leave the outer half per cent empty is 2e-9.
        assert -1.0 <= share.min() < -0.99, name
        assert 0.99 < share.max() <= 1.0, name
    wave = found["wave_amplitude_heave"] / -0.02
    assert 0.6 <= wave.min() < 0.61
    assert 1.39 < wave.max() <= 1.4
    assert np.ptp(found["wave_phase_yaw"]) > 6.2
    assert np.ptp(found["initial_east"]) == pytest.approx(4.0, rel=0.01)
    assert set(found) == {
        *UNCERTAIN,
        *(f"wave_{x}_{a}" for x in ("amplitude", "phase") for a in vars(axes())),
        "initial_north",
        "initial_east",
    }


def test_levels_share_their_draws():
    names = ("drag", "wave_phase_surge")
    narrow, wide = (
        columns_of(uniform_uncertainty(SCENARIO, h, 0.5), 50) for h in (0.1, 0.5)
    )
    drag = float(SCENARIO.plant.parameters.drag)
    np.testing.assert_allclose(
        5.0 * (narrow[names[0]] / drag - 1.0), wide[names[0]] / drag - 1.0, atol=1e-12
    )
    np.testing.assert_array_equal(narrow[names[1]], wide[names[1]])


def test_a_member_is_the_loop_with_its_values_and_nothing_else_changed():
    uncertainty = uniform_uncertainty(SCENARIO, 0.2, 0.5, 1.0)
    design = MonteCarlo(3, uncertainty.names())
    members = uncertainty.sample(design, member_keys(3, 4))
    member = jax.tree.map(lambda x: x[2], members)
    loop, sea, noise = with_member(LOOP, member)
    values = uncertainty.values(design.rows(2, 1))[0]
    for quantity, value in zip(uncertainty.quantities, values, strict=True):
        assert float(look_up(loop.scenario, quantity.path)) == value
    restored = dataclasses.replace(
        loop.scenario,
        plant=SCENARIO.plant,
        disturbance=SCENARIO.disturbance,
        initial_state=SCENARIO.initial_state,
    )
    for a, b in zip(jax.tree.leaves(restored), jax.tree.leaves(SCENARIO), strict=True):
        np.testing.assert_array_equal(a, b)
    assert loop.controller is LOOP.controller
    assert noise is None
    t = np.asarray(SCENARIO.clock.times())
    wave = loop.scenario.disturbance
    np.testing.assert_allclose(
        sea.roll,
        float(wave.amplitude.roll)
        * np.sin(float(wave.frequency.roll) * t + float(wave.phase.roll)),
        atol=1e-15,
    )


def test_only_sinusoids_are_varied_wherever_they_are():
    pushed = Sum((Constant(axes(surge=0.5)), SCENARIO.disturbance))
    scenario = dataclasses.replace(SCENARIO, disturbance=pushed)
    paths = [q.path for q in uniform_uncertainty(scenario, 0.0, 0.5).quantities]
    assert len(paths) == 12
    assert all(path.startswith("disturbance.terms.1.") for path in paths)


def test_correlated_quantities_keep_their_own_distributions():
    laws = [relative(SCENARIO, n, Uniform(0.8, 1.2)) for n in ("drag", "lift_slope")]
    group = Group("g", ("drag", "lift_slope"), ((1.0, 0.8), (0.8, 1.0)))
    rows = rows_of(Uncertainty(SCENARIO, tuple(laws), (group,)), 4000)
    ratio = rows / [7.19, 440.99]
    # Of the ranks of a Gaussian copula: 6/pi asin(r/2).
    wanted = 6 / np.pi * np.arcsin(0.4)
    assert np.corrcoef(ratio.T)[0, 1] == pytest.approx(wanted, abs=0.03)
    assert ratio.min() >= 0.8
    assert ratio.max() <= 1.2
    np.testing.assert_allclose(ratio.std(axis=0), 0.4 / np.sqrt(12), rtol=0.04)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: uniform_uncertainty(SCENARIO, 1.0), r"parameters must be in \[0, 1\)"),
        (lambda: uniform_uncertainty(SCENARIO, 0.2, -0.1), "amplitude must be in"),
        (lambda: uniform_uncertainty(SCENARIO, 0.2, 0.5, -1.0), "position must be"),
        (lambda: relative(SCENARIO, "drag", Uniform(-0.1, 2.0)), "stay positive"),
        (lambda: relative(SCENARIO, "dragg", Uniform(0.9, 1.1)), "no 'dragg'"),
        (
            lambda: Uncertainty(
                SCENARIO, (relative(SCENARIO, "drag", Uniform(0.9, 1.1)),) * 2
            ),
            "drag is uncertain in two ways",
        ),
        (
            lambda: Uncertainty(
                SCENARIO, (Quantity("x", "clock.speed", "s", Uniform(0.0, 1.0)),)
            ),
            "clock.speed is no number of this scenario",
        ),
    ],
)
def test_what_cannot_be_uncertain_is_refused(make, text):
    with pytest.raises(ValueError, match=text):
        make()


def test_the_template_makes_everything_uncertain_that_it_names():
    uncertainty = build_uncertainty(PLAIN, SCENARIO)
    found = columns_of(uncertainty, 2000)
    nominal = SCENARIO.plant.parameters
    ratio = {n: found[n] / float(getattr(nominal, n)) for n in UNCERTAIN if n in found}
    assert 0.8 <= ratio["surge_mass"].min() < ratio["surge_mass"].max() <= 1.2
    assert 0.8 <= ratio["drag"].min() < 0.81
    assert np.corrcoef(ratio["drag"], ratio["lift_slope"])[0, 1] > 0.4
    assert np.log(ratio["roll_damping"]).std() == pytest.approx(0.2, rel=0.05)
    assert found["initial_heading"].std() == pytest.approx(np.radians(5), rel=0.05)
    assert found["sensor_bias_heading"].std() == pytest.approx(np.radians(1), rel=0.05)
    stuck = found["mass_angle_stuck_from"] < NEVER
    assert 0.01 < stuck.mean() < 0.03
    assert found["mass_angle_stuck_from"][stuck].max() <= 800.0
    assert found["buoyancy_mass_effectiveness"].min() >= 0.3
    assert uncertainty.has_chance()
    assert float(uncertainty.scenario.sensors["depth"].noise) == 0.01
    loop = dataclasses.replace(LOOP, scenario=uncertainty.scenario)
    member = uncertainty.members(rows_of(uncertainty, 1), jr.split(jr.key(0), 1))
    member = jax.tree.map(lambda x: x[0], member)
    _, sea, noise = with_member(loop, member)
    assert set(noise) == {"heading", "depth"}
    assert jnp.std(noise["depth"]) == pytest.approx(0.01, rel=0.3)
    # Coloured noise on top of the waves: neighbouring ticks differ by chance.
    assert np.std(np.diff(sea.surge, 2)) > 1e-4


def test_a_file_of_a_number_is_the_number():
    text = (
        '[[vehicle]]\nlaw = "uniform"\nhalf_width = 0.2\n'
        '[disturbance]\namplitude = {law = "uniform", half_width = 0.5}\n'
        'phase_deg = {law = "uniform", half_width = 180.0}\n'
    )
    file = build_uncertainty(tomllib.loads(text), SCENARIO)
    same = uniform_uncertainty(SCENARIO, 0.2, 0.5)
    assert file.names() == same.names()
    np.testing.assert_allclose(rows_of(file, 20), rows_of(same, 20), rtol=1e-14)
    assert not file.has_chance()


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ("nothing is uncertain",)),
        ("[vehicl]\n", ("unknown key vehicl", "did you mean vehicle?")),
        ('[[vehicle]]\nlaw = "gauss"\n', ("vehicle[0].law", "'gauss'", "log-normal")),
        ("[[vehicle]]\n", ("vehicle[0].law is missing",)),
        ('[[vehicle]]\nlaw = "uniform"\nhalf_width = 1.5\n', ("must stay positive",)),
        ('[[vehicle]]\nlaw = "uniform"\nhalf_width = "x"\n', ("half_width", "'x'")),
        (
            '[[vehicle]]\nnames = ["dragg"]\nlaw = "uniform"\nhalf_width = 0.1\n',
            ("'dragg'",),
        ),
        (
            '[[vehicle]]\nlaw = "normal"\nstandard_deviation = -1.0\n',
            ("vehicle[0]", "deviation must be positive"),
        ),
        (
            '[[vehicle]]\nlaw = "uniform"\nhalf_width = 0.1\ncorrelation = 1.5\n',
            ("correlation must be", "positive definite"),
        ),
        (
            '[disturbance]\nstrength = {law = "uniform", wide = 1.0}\n',
            ("disturbance.strength.low is missing",),
        ),
        (
            '[disturbance]\nstrength = {law = "uniform", half_width = 0.1, x = 1}\n',
            ("unknown key disturbance.strength.x",),
        ),
        ("[sensors.depth]\nnoise_deg = 1.0\n", ("sensors.depth.noise_deg", "noise_m")),
        ("[sensors.depth]\nnoise_m = -1.0\n", ("sensors.depth", "noise must be")),
        (
            '[initial_state]\npitch_deg = {law = "uniform", half_width = 95}\n',
            ("initial_state.pitch_deg", "90"),
        ),
        (
            "[actuators.mass_angle]\ntime_constant_s = 0.0\n",
            ("actuators.mass_angle.time_constant_s", "positive"),
        ),
        (
            '[actuators.mass_angle]\ntime_constant_s = {law = "normal"}\n',
            ("actuators.mass_angle.time_constant_s.mean is missing",),
        ),
        (
            '[[failure]]\nactuator = "rudder"\nkind = "stuck"\ntime_s = 1\n',
            ("failure[0].actuator", "'rudder'", "mass_angle"),
        ),
        (
            '[[failure]]\nactuator = "mass_angle"\nkind = "weak"\ntime_s = 1\n'
            "effectiveness = 1.5\n",
            ("failure[0].effectiveness", "[0, 1]"),
        ),
        (
            '[[failure]]\nactuator = "mass_angle"\nkind = "stuck"\ntime_s = 1\n'
            "probability = 2.0\n",
            ("failure[0].probability", "[0, 1]"),
        ),
        (
            '[[failure]]\nactuator = "mass_angle"\nkind = "stuck"\ntime_s = 1\n' * 2,
            ("mass_angle_stuck_from is uncertain in two ways",),
        ),
    ],
)
def test_a_wrong_file_is_refused_in_words_one_can_act_on(tmp_path, text, parts):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as refusal:
        load_uncertainty(path, SCENARIO)
    assert str(refusal.value).startswith(f"{path}: ")
    for part in parts:
        assert part in str(refusal.value)


def test_each_parameter_of_a_table_may_have_a_deviation_of_its_own():
    table = {
        "names": ["drag", "lift_slope"],
        "law": "log-normal",
        "standard_deviation": [0.05, 0.2],
        "correlation": [[1.0, -0.7], [-0.7, 1.0]],
    }
    found = build_uncertainty({"vehicle": [table]}, SCENARIO)
    logs = np.log(rows_of(found, 4000))
    assert logs.std(axis=0) == pytest.approx([0.05, 0.2], rel=0.05)
    assert np.corrcoef(logs.T)[0, 1] == pytest.approx(-0.7, abs=0.03)
    short = {**table, "standard_deviation": [0.1]}
    with pytest.raises(
        ConfigError, match=r"standard_deviation must be one number or a"
    ):
        build_uncertainty({"vehicle": [short]}, SCENARIO)
