"""Fits: against closed forms, a known glider with noise, and a real flight held out."""

import dataclasses
import json
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from html_page import mailable
from scipy.signal import lfilter

from jaxglider.files.mission import load_mission
from jaxglider.files.uncertainty import load_uncertainty
from jaxglider.trim.steady_motion import Target, steady_motion
from jaxglider.vehicle.published import load_vehicle
from tuning import fit
from tuning.identification.glider import resized, value_of, with_values
from tuning.identification.information.least_squares import (
    Solution,
    soft_l1,
    solve,
    strongest_pairs,
)
from tuning.identification.information.noise import Noise, estimate_noise
from tuning.identification.parameters import free_parameters, placed
from tuning.identification.predict import glide, predict
from tuning.identification.record.flight_record import FlightRecord, Series
from tuning.identification.record.reading import read_record
from tuning.identification.record.uniform import uniform
from tuning.identification.samples import Linearised, chosen_rows
from tuning.identification.start import starting_glider
from tuning.identification.verdict import simulate
from tuning.identification.windows import Windows, cut

COMET = Path(__file__).parents[1] / "docs" / "examples" / "records" / "comet-2016.csv"
VOLUME = 70.0 / 1004.0
SLOCUM = load_vehicle("slocum")


@pytest.fixture(scope="module")
def record():
    return read_record(COMET)


@pytest.fixture(scope="module")
def steady(record):
    """Depth rate alone, with the sensor's own pitch."""
    return fit(record, kind="steady", speed=False, volume=VOLUME)


@pytest.fixture(scope="module")
def driven(record):
    """Depth rate and speed, with the sensor's own pitch."""
    return fit(record, kind="driven", volume=VOLUME)


def middle_error(result):
    """Error of the depth rate between 10 and 35 m of the dives held out, rms [m/s]."""
    flight = result.fit.flight
    held = np.isin(flight.dive, result.fit.plan.held_out) & flight.good
    at = held & (flight.depth > 10.0) & (flight.depth < 35.0)
    error = result.verdict.after["depth_rate"] - flight.depth_rate
    return float(np.sqrt(np.mean(error[at] ** 2)))


def test_depth_rate_alone_fits_and_warns_that_speed_is_untested(steady):
    scores = steady.verdict.scores
    assert scores["depth_rate"]["held_out_steady"].rms < 0.0045
    # A tilted sensor: depth rate fits as well as ever, the speed is far too low.
    assert scores["speed"]["held_out"].bias == pytest.approx(-0.042, abs=0.008)
    assert any(text.startswith("SPEED IS UNTESTED") for text in steady.remarks)
    assert abs(steady["mass"].value - 70.102) < 0.008


def test_speed_shows_the_tilt_of_the_pitch_sensor(driven):
    # Merckelbach found 0.86 for this glider, by other means.
    scale = driven["pitch_scale"]
    assert abs(scale.value - 0.86) < 2.0 * scale.deviation
    assert scale.value == pytest.approx(0.902, abs=0.005)
    scores = driven.verdict.scores
    # 0.42 cm/s on the full record (benchmarks/bench_fit.py); this table has a quarter.
    assert middle_error(driven) < 0.0045
    assert scores["speed"]["held_out"].rms < 0.0115
    assert abs(scores["speed"]["held_out"].bias) < 0.004
    assert not any("SPEED IS UNTESTED" in text for text in driven.remarks)


def test_the_fit_says_what_it_does_not_know(driven):
    assert not driven["lift_slope"].identified
    told = " ".join(driven.remarks)
    assert "lift_slope is not identifiable from this record" in told
    # No record makes an interval wider than its prior.
    shares = [int(x) for x in re.findall(r"interval is (\d+)% of the prior's", told)]
    assert shares
    assert max(shares) <= 100
    assert "HEADING IS NOT TO BE TUNED" in told
    assert "speed: that of dive 18 (0.20 m/s) is far from that of all others" in told
    assert "pitch_offset and mass are told together only" in told
    assert driven.fit.plan.held_out == tuple(range(10, 19))


def test_turns_are_better_with_the_lag_of_the_actuators(driven):
    fitted = driven.verdict.scores["depth_rate"]["held_out"].rms
    prompt = with_values(driven.fit.after, {"actuator_lag": 0.0})
    flight = driven.fit.flight
    held = np.isin(flight.dive, driven.fit.plan.held_out) & flight.good
    error = simulate("driven", prompt, flight)["depth_rate"] - flight.depth_rate
    assert fitted < 0.005 < np.sqrt(np.mean(error[held] ** 2))


def test_files_of_a_fit_are_those_of_the_other_commands(driven, tmp_path, call):
    driven.save(tmp_path / "out")
    vehicle = load_vehicle(tmp_path / "out" / "vehicle.toml")
    drag = driven["drag"]
    assert float(vehicle.parameters.drag) == pytest.approx(drag.value, rel=1e-12)
    assert vehicle.deviations["parameters.drag"] == pytest.approx(drag.deviation)
    mission = load_mission(tmp_path / "out" / "mission.toml")
    loop = mission.loop
    assert float(loop.scenario.plant.parameters.drag) == pytest.approx(drag.value)
    uncertain = load_uncertainty(tmp_path / "out" / "uncertainty.toml", loop.scenario)
    assert [q.name for q in uncertain.quantities] == ["drag", "lift_slope"]
    assert uncertain.quantities[0].standard_deviation() == pytest.approx(
        drag.deviation, rel=0.02
    )
    names = [p.name for p in driven.fit.plan.free]
    both = [names.index(n) for n in ("drag", "lift_slope")]
    covariance = driven.fit.solution.covariance[np.ix_(both, both)]
    correlation = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert uncertain.groups[0].correlation[0][1] == pytest.approx(correlation, abs=1e-6)
    report = (tmp_path / "out" / "report.md").read_text()
    assert "**not identifiable**" in report
    assert driven.record.digest in report
    content = json.loads((tmp_path / "out" / "fit.json").read_text())
    assert content["scores"]["speed"]["held_out"]["rms"] < 0.0115
    assert len(mailable(tmp_path / "out" / "report.html").loads) == 2
    assert (tmp_path / "out" / "fit.png").stat().st_size > 10_000
    assert (tmp_path / "out" / "residuals.png").stat().st_size > 10_000
    assert call("validate", tmp_path / "out" / "mission.toml")[0] == 0
    # What was fitted is where the next fit may start from.
    again = free_parameters(("drag",), driven.fit.after, driven.vehicle)
    assert again[0].stated
    assert again[0].prior == pytest.approx(drag.deviation)


def test_the_result_prints_before_and_after(driven):
    text = str(driven)
    assert "9 dives, 9 held out" in text
    assert "not identified" in text
    with pytest.raises(KeyError, match="yaw_damping was not fitted"):
        driven["yaw_damping"]


@pytest.fixture(scope="module")
def glider(steady):
    return steady.fit.after


@pytest.fixture(scope="module")
def balanced(glider):
    """State and command of a glide at 25 degrees and 0.3 m/s, by the solver of trim."""
    target = Target(speed=0.3, glide_angle=np.radians(-25.0), turn_rate=0.0)
    motion = jax.jit(steady_motion)(glider.plant(), target)
    assert bool(motion.converged)
    return motion.state, motion.command


def level(glider, count, **values):
    """Windows of one row with everything at rest but some inputs."""
    rows = {
        f.name: jnp.zeros((1, count))
        for f in dataclasses.fields(Windows)
        if f.name not in ("dt", "half_width", "longest")
    }
    rows |= {k: jnp.full((1, count), v) for k, v in values.items()}
    return Windows(dt=1.0, half_width=5, longest=0.6, **rows)


def test_the_glide_in_balance_is_that_of_the_plant(glider, balanced):
    state, command = balanced
    u, w = glide(glider, state.pitch, command.buoyancy_mass)
    assert float(u) == pytest.approx(float(state.surge), rel=1e-6)
    assert float(w) == pytest.approx(float(state.heave), rel=1e-6)


def test_no_glide_is_sought_where_there_is_none(glider):
    pitch = jnp.asarray([0.05, -0.4, 0.4])
    heavy = jnp.asarray([0.2, -0.2, 0.2])

    @jax.jit
    def surge(at):
        return jax.jvp(lambda x: glide(glider, x, heavy)[0], (at,), (jnp.ones(3),))

    values, slopes = surge(pitch)
    assert np.asarray(values) == pytest.approx(0.0)
    assert np.all(np.isfinite(slopes))


def test_driven_and_closed_end_in_the_steady_glide_of_the_plant(glider, balanced):
    state, command = balanced
    density = 1005.0
    neutral = with_values(glider, {"compressibility": 0.0, "actuator_lag": 0.0})
    neutral = with_values(
        neutral, {"mass": density * float(glider.volume), "position_offset": 0.0}
    )
    inputs = level(
        glider,
        200,
        density=density,
        temperature=10.0,
        pitch=float(state.pitch) * 1.1,
        ballast=-float(command.buoyancy_mass) / density,
        mass_position=float(command.mass_position),
    )
    found = jax.jit(predict, static_argnums=0)("closed", neutral, inputs)
    assert float(found["pitch"][0, -1]) == pytest.approx(float(state.pitch), abs=1e-4)
    assert float(found["speed"][0, -1]) == pytest.approx(0.3, rel=1e-3)
    sink = 0.3 * np.sin(np.radians(25.0))
    assert float(found["depth_rate"][0, -20]) == pytest.approx(sink, rel=1e-3)
    inputs = dataclasses.replace(inputs, pitch=inputs.pitch / 1.1)
    found = jax.jit(predict, static_argnums=0)("driven", neutral, inputs)
    assert float(found["speed"][0, -1]) == pytest.approx(0.3, rel=1e-3)


def test_the_actuators_act_as_late_as_they_are_said_to(glider):
    late = with_values(glider, {"actuator_lag": 2.5})
    inputs = level(glider, 40, density=1005.0, temperature=10.0)
    ramp = dataclasses.replace(inputs, ballast=1e-6 * jnp.arange(40.0)[None, :])
    from tuning.identification.predict import _acting

    acting = np.asarray(_acting(late, ramp).ballast)[0]
    assert acting[10] == pytest.approx(7.5e-6)


REPEATS = 100


def thinned(flight, every):
    """Every so many samples of a flight: a light model."""
    changes = {
        f.name: getattr(flight, f.name)[::every]
        for f in dataclasses.fields(flight)
        if f.name not in ("dt", "half_width", "notes")
    }
    return dataclasses.replace(flight, dt=every * flight.dt, half_width=4, **changes)


@pytest.fixture(scope="module")
def repeats(steady):
    """A known glider's numbers, and their estimates from records with noise.

    The noise is correlated in time; each is a fit of its own.
    """
    flight = thinned(steady.fit.flight, 4)
    before = steady.fit.before
    truth = with_values(before, {"drag": 8.4, "mass": 70.11})
    stretches = cut(flight, "steady", flight.steady)
    _, rows, unbroken = chosen_rows(flight, stretches, ("depth_rate",))
    free = free_parameters(("drag", "mass"), before, SLOCUM)
    model = Linearised(before, free, stretches.inputs, "steady", rows)
    clean = simulate("steady", truth, flight)["depth_rate"]
    rng = np.random.default_rng(1)
    found = []
    for _ in range(REPEATS):
        noise = lfilter([1.0], [1.0, -0.8], rng.normal(size=len(clean)))
        noisy = clean + 0.004 * noise / noise.std()
        measured = {"depth_rate": noisy[stretches.index.ravel()[rows["depth_rate"]]]}
        found.append(solve(model, measured, 2, stretches=unbroken))
    return truth, free, found


@pytest.mark.parametrize("number", [0, 1])
def test_intervals_cover_a_known_glider(repeats, number):
    truth, free, found = repeats
    one = free[number]
    true = float(value_of(truth, one.name))
    values = np.array([float(one.value(s.x[number])) for s in found])
    said = np.array(
        [one.slope(s.x[number]) * s.covariance[number, number] ** 0.5 for s in found]
    )
    inside = int((np.abs(values - true) <= 1.96 * said).sum())
    # 95 of 100, within three standard deviations of the binomial distribution.
    assert 88 <= inside <= 100
    assert 0.8 < said.mean() / values.std() < 1.4
    assert values.mean() == pytest.approx(true, abs=3.5 * values.std() / 10.0)


def test_noise_is_estimated_with_its_correlation_time():
    rng = np.random.default_rng(0)
    values = np.zeros(20_000)
    for k in range(1, len(values)):
        values[k] = 0.8 * values[k - 1] + rng.normal()
    found = estimate_noise("depth_rate", values)
    # Of a first-order process: τ = (1 + a)/(1 − a) = 9, σ = 1/√(1 − a²).
    assert found.correlation_time == pytest.approx(9.0, rel=0.15)
    assert found.sigma == pytest.approx(1.0 / 0.6, rel=0.05)
    assert found.independent() == pytest.approx(20_000 / 9.0, rel=0.15)


def test_the_robust_loss_and_its_derivatives():
    z = np.linspace(0.1, 50.0, 7)
    c = np.full(7, 4.0)
    value, slope, bend = soft_l1(z, c)
    step = 1e-4
    up, down = soft_l1(z + step, c), soft_l1(z - step, c)
    assert (up[0] - down[0]) / (2 * step) == pytest.approx(slope, rel=1e-6)
    assert (up[1] - down[1]) / (2 * step) == pytest.approx(bend, rel=1e-5)
    assert soft_l1(z, np.full(7, np.inf))[0] == pytest.approx(z)
    assert np.all(value < z)


def test_least_squares_of_a_line_is_the_closed_form():
    rng = np.random.default_rng(2)
    x = np.linspace(-1.0, 1.0, 200)
    y = 0.3 + 0.5 * x + 0.01 * rng.normal(size=200)
    basis = np.stack([np.ones(200), x], axis=1)

    def line(at):
        return {"depth_rate": basis @ at}, {"depth_rate": basis}

    found = solve(
        line, {"depth_rate": y}, 2, noise={"depth_rate": Noise(0.01, 1.0, 200)}
    )
    information = basis.T @ basis / 0.01**2
    expected = np.linalg.inv(information + np.eye(2))
    assert found.covariance == pytest.approx(expected, rel=1e-9)
    assert found.x == pytest.approx(np.linalg.lstsq(basis, y)[0], abs=2e-4)
    assert found.condition() == pytest.approx(1.0, abs=1e-6)


def test_what_leaves_no_trace_is_infinite_and_pairs_are_named():
    information = np.diag([1.0, 0.0])
    covariance = np.array([[1.0, 0.97], [0.97, 1.0]])
    one = Solution(np.zeros(2), covariance, information, {}, 1, True)
    assert one.condition() == float("inf")
    assert strongest_pairs(covariance, ["a", "b"]) == [("b", "a", 0.97)]


def test_signs_are_kept_and_offsets_are_free(steady):
    glider = steady.fit.before
    free = free_parameters(("yaw_damping", "pitch_offset"), glider, SLOCUM)
    assert (free[0].signed, free[1].signed) == (True, False)
    moved = placed(glider, free, jnp.asarray([-5.0, -5.0]))
    assert float(moved.parameters.yaw_damping) < 0.0
    assert float(moved.record.pitch_offset) == pytest.approx(-0.15)
    for one, x in zip(free, (0.7, -0.3), strict=True):
        difference = (one.value(x + 1e-6) - one.value(x - 1e-6)) / 2e-6
        assert one.slope(x) == pytest.approx(float(difference), rel=1e-6)


def test_a_resized_vehicle_has_that_mass():
    heavier = resized(SLOCUM, 75.0)
    assert float(heavier.body.displaced_mass(heavier.parameters)) == pytest.approx(75.0)
    assert float(heavier.parameters.surge_mass) == pytest.approx(89.0)
    with pytest.raises(ValueError, match="mass must leave Slocum a hull"):
        resized(SLOCUM, 5.0)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"free": ("dragg",)}, "received 'dragg'"),
        ({"free": ("moving_mass",)}, "the same as others"),
        ({"free": ("lift_offset", "gravity")}, "received 'gravity'"),
        ({"kind": "wild"}, "kind must be one of steady, driven, closed"),
        ({"held_out": "none"}, "split must be one of half, alternate"),
        ({"mass": -1.0}, "mass must be"),
        ({"volume": 0.0}, "volume must be"),
    ],
)
def test_arguments_that_cannot_be_used_are_refused(record, arguments, complaint):
    with pytest.raises(ValueError, match=complaint):
        fit(record, **arguments)


def test_a_record_that_cannot_be_fitted_is_told_why(record):
    few = {k: s for k, s in record.channels.items() if k != "mass_position"}
    without = dataclasses.replace(record, channels=few)
    with pytest.raises(ValueError, match="the closed fit needs mass_position"):
        fit(without, kind="closed")
    bare = {k: s for k, s in few.items() if k != "ballast"}
    with pytest.raises(ValueError, match="a fit needs ballast, which the record lacks"):
        fit(dataclasses.replace(record, channels=bare))
    short = {
        k: Series(s.time[s.time < 1000.0], s.values[s.time < 1000.0])
        for k, s in few.items()
    }
    with pytest.raises(ValueError, match="needs two dives at least"):
        fit(FlightRecord("short", "made", short))
    flat = dataclasses.replace(load_vehicle("slocum"), body=None)
    with pytest.raises(ValueError, match="Slocum has no table"):
        fit(without, flat)


def test_windows_and_the_whole_flight_predict_the_same(steady):
    flight, glider = steady.fit.flight, steady.fit.after
    stretches = cut(flight, "steady", flight.good)
    found = jax.jit(predict, static_argnums=0)("steady", glider, stretches.inputs)
    whole = simulate("steady", glider, flight)["depth_rate"]
    at = stretches.compared
    rate = np.asarray(found["depth_rate"])
    assert rate[at] == pytest.approx(whole[stretches.index[at]], abs=1e-12)


def test_windows_hold_each_sample_once_and_run_in_first(record):
    flight = uniform(record)
    stretches = cut(flight, "driven", flight.good)
    seen = stretches.index[stretches.compared]
    assert sorted(seen) == list(np.flatnonzero(flight.good))
    first = np.argmax(stretches.compared, axis=1)
    assert np.all(first >= round(60.0 / flight.dt))


def test_the_start_is_neutral_between_dives_and_climbs(record):
    flight = uniform(record)
    glider = starting_glider(SLOCUM, flight, VOLUME)
    assert float(glider.record.mass) == pytest.approx(70.102, abs=0.05)


def test_fit_command_refuses_with_a_sentence(call, tmp_path):
    code, _, err = call("fit", COMET, "--kind", "steady", "--free", "dragg")
    assert code == 2
    assert "free must name numbers of the glider" in err
    assert "Traceback" not in err
