"""The laws that gliders fly, against their records and their printed numbers."""

import math
import tomllib
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import paper
from jaxglider.control.flown.battery import ENOUGH, Looks, Shifts, looked, remembered
from jaxglider.control.flown.fin import NEARLY_OVER, Turning, steered
from jaxglider.control.flown.seaglider import Seaglider
from jaxglider.control.flown.slocum import Slocum
from jaxglider.control.parts import beyond
from jaxglider.core.toml import ConfigError
from jaxglider.files.gains import decode_gains
from jaxglider.files.settings.lists import Settings, read_settings, settings_of
from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    Reference,
    zeros,
)
from jaxglider.vehicle.full_plant import full_plant
from jaxglider.vehicle.published import load_vehicle
from tuning.cli.main import main

RECORD = Path(__file__).parent / "records" / "comet-2016-heading.csv"
FIN_LIMIT = 0.425
COMET = paper.make_controller(
    "slocum", "switching", full_plant(load_vehicle("slocum-comet")).model()
)


@pytest.fixture(scope="module")
def record():
    lines = RECORD.read_text().splitlines()
    lines = [line for line in lines if not line.startswith("#")]
    # The run that ends the wait for the integral has none in the log: it is zero.
    rows = [[x or "0" for x in line.split(",")] for line in lines[1:]]
    rows = np.array(rows, float)
    return dict(zip(lines[0].split(","), rows.T, strict=True))


def over(record):
    """Whether the fin was hard over, as each run had it from the one before."""
    return np.abs(record["fin_rad"][:-1]) >= NEARLY_OVER * FIN_LIMIT


def test_the_heading_law_gives_the_commands_of_a_flight_log(record):
    error, told = record["error_rad"], record["fin_command_rad"]
    integral, since = record["error_integral_rad_s"], np.diff(record["time_s"])
    # The log has the integral after a run has put it to zero, the law used it before.
    fresh = (integral[1:] == 0.0) & (integral[:-1] != 0.0)
    used = np.where(fresh, integral[:-1] + error[:-1] * since, integral[1:])
    assert fresh.sum() == 1
    before = Turning(error[:-1], used, np.full(len(since), 1e3), told[:-1] / FIN_LIMIT)
    run = jax.vmap(steered, in_axes=(0, 0, 0, 0, None, 0))
    rate = record["error_rate_rad_s"][1:]
    given = jax.tree.map(jnp.asarray, (before, error[1:], rate, over(record)))
    assert isinstance(COMET, Slocum)
    after = run(*given, COMET.fin_gains(), jnp.asarray(since))
    moved = np.diff(told) != 0.0
    assert 100 < moved.sum() < len(moved) - 40
    np.testing.assert_allclose(FIN_LIMIT * after.asked, told[1:], atol=1e-6)


def test_the_heading_law_with_its_own_memory_follows_the_log(record):
    """Holds, integral and its rules as the law has them; only the errors are given."""
    since = np.diff(record["time_s"])
    rate = record["error_rate_rad_s"][1:]
    given = (record["error_rad"][1:], rate, over(record), since)

    def run(turning, now):
        error, rate, over, since = now
        after = steered(turning, error, rate, over, COMET.fin_gains(), since)
        return after, after

    zero = jnp.zeros(())
    _, after = jax.jit(partial(jax.lax.scan, run))(
        Turning(zero + record["error_rad"][0], zero, zero, zero + 1.0),
        jax.tree.map(jnp.asarray, given),
    )
    told = FIN_LIMIT * np.asarray(after.asked)
    wrong = np.abs(told - record["fin_command_rad"][1:])
    assert wrong.max() < 2e-3
    # The integral is the log's from the run on that begins it again, within its jitter.
    summed = np.abs(after.integral[:-1] - record["error_integral_rad_s"][2:])
    assert np.quantile(summed, 0.9) < 0.5


def test_a_rounding_of_the_wait_costs_the_integral_no_run():
    """120 s are 30 runs of 4 s, whether 120 s is a little more or less."""

    def integral(wait):
        gains = COMET.fin_gains()._replace(wait=wait)

        def run(turning, over):
            told = jnp.asarray(0.2), jnp.asarray(0.0), over, gains, jnp.asarray(4.0)
            after = steered(turning, *told)
            return after, after.integral

        zero = jnp.zeros(())
        hard_over = jnp.arange(40) < 2
        return jax.lax.scan(run, Turning(zero, zero, zero, zero), hard_over)[1]

    found = jax.jit(jax.vmap(integral))(120.0 * (1.0 + jnp.array([0.0, 1e-6, -1e-6])))
    # Two runs hard over, the one that sees it back, thirty of waiting.
    first = np.argmax(np.asarray(found) > 0.0, axis=1)
    np.testing.assert_array_equal(first, 33)


LOOKS = Looks(jnp.asarray(0.05), jnp.asarray(8.0), jnp.asarray(60.0))


def runs(errors, push=0.001, climbing=False):
    """Shifts after runs of 4 s that saw these errors."""
    zero = jnp.zeros(())
    shifts = Shifts(zero, zero, zero, zero, zero, LOOKS.wait)
    flags = jnp.asarray(climbing), jnp.asarray(True)
    for error in errors:
        given = jnp.asarray(error), jnp.asarray(push), *flags
        shifts = looked(shifts, *given, LOOKS, jnp.asarray(4.0))
        yield shifts


def test_the_pitch_servo_looks_ever_more_seldom_while_all_is_well():
    waits = [float(s.wait) for s in runs([0.01] * 60)]
    changes = [n + 1 for n in range(1, 60) if waits[n] != waits[n - 1]]
    # After 8 s, then 16, 32 and 60 s later, and every 60 s from there.
    assert changes == [2, 6, 14]
    assert waits[-1] == 60.0
    moves = [float(s.dive) for s in runs([0.1] * 6)]
    np.testing.assert_allclose(moves, [0.0, 1e-3, 1e-3, 2e-3, 2e-3, 3e-3])


def test_a_half_begins_with_the_mean_that_had_the_last_one_in_its_band():
    *_, shifts = runs([0.1] * 4 + [0.01] * 6)
    yes, no = jnp.asarray(True), jnp.asarray(False)
    assert float(shifts.dive) == pytest.approx(2e-3)
    assert float(shifts.count) == 6.0 > ENOUGH
    after = remembered(shifts, no, yes, LOOKS)
    assert float(after.dive) == pytest.approx(float(shifts.total) / 6.0)
    assert float(after.climb) == float(after.count) == 0.0
    *_, short = runs([0.1] * 4 + [0.01] * 3)
    assert float(remembered(short, no, yes, LOOKS).dive) == float(short.dive)


def test_the_slope_of_a_dead_band_is_that_of_its_smooth_stand_in():
    assert float(beyond(jnp.asarray(0.11), jnp.asarray(0.1))) == 1.0
    assert float(beyond(jnp.asarray(0.1), jnp.asarray(0.1))) == 0.0
    # A logistic function as wide as a fifth of the threshold.
    slope = jax.grad(beyond)(jnp.asarray(0.11), jnp.asarray(0.1))
    soft = 1.0 / (1.0 + np.exp(-0.01 / 0.02))
    assert float(slope) == pytest.approx(soft * (1.0 - soft) / 0.02)


def test_the_map_of_a_seaglider_gives_its_printed_place():
    law = Seaglider(COMET.model)
    # -16.6 deg and -160.6 cm^3 displaced, 40 deg/cm and 0.0015 cm/cm^3: -0.656 cm, with
    # forward counted negative.
    place = law.place(jnp.asarray(math.radians(-16.6)), jnp.asarray(160.6 * 1.0275e-3))
    assert 100.0 * float(place) == pytest.approx(0.656, abs=1e-3)
    listed = {"PITCH_GAIN": 40.0, "PITCH_VBD_SHIFT": 0.0015, "ROLL_DEG": 40.0}
    numbers = Settings("seaglider", listed).gains()["controller"]
    flown = decode_gains(
        {"controller": numbers, "observer": {"type": "none"}}, "switching", COMET.model
    ).controller
    place = flown.place(jnp.asarray(math.radians(-16.6)), jnp.asarray(0.0))
    assert float(place - flown.pitch_centre) == pytest.approx(0.166 / 40.0)
    assert float(flown.roll_angle) == pytest.approx(math.radians(40.0))


def flown_turn(law, headings, climbing=False, dt=5.0):
    """Mass angles that a law tells while the heading is as given, and 0 is wanted."""
    pitch = 0.4 if climbing else -0.4
    zero = jnp.zeros(())

    def tick(carry, given):
        heading, clock = given
        state = GliderState.at_rest(pitch=pitch, heading=heading, depth=10.0)
        measured = Measurement(state, state.attitude(), zeros(Command), zeros(BodyAxes))
        asked = Reference(
            Channels(10.0, pitch, 0.0),
            Channels(0.1, 0.0, 0.0),
            zeros(Channels),
            clock,
            jnp.asarray(0, jnp.int32),
            jnp.asarray(False),
        )
        command, carry, _ = law.step(
            carry, measured, asked, law.bounds(clock), zero + dt
        )
        return carry, command.mass_angle

    headings = jnp.asarray(headings, float)
    clocks = dt * jnp.arange(1.0, 1.0 + len(headings))
    return np.asarray(jax.lax.scan(tick, law.init(), (headings, clocks))[1])


def test_a_seaglider_turns_from_stop_to_stop_until_its_error_has_passed_zero():
    model = paper.design_model(full_plant(load_vehicle("seaglider")), 1.0)
    law = paper.make_controller("seaglider", "switching", model)
    # 20 deg to starboard of its heading: it rolls to port, and back once it is past.
    away = [0.35] * 4 + [0.1] * 3 + [-0.02] * 3
    angle = 0.698
    dive = flown_turn(law, away)
    np.testing.assert_allclose(dive, [-angle] * 7 + [0.0] * 3, atol=1e-12)
    np.testing.assert_allclose(flown_turn(law, away, climbing=True), -dive, atol=1e-12)
    # Within its band of 10 deg it does nothing, and no turn lasts beyond 225 s.
    assert not flown_turn(law, [0.17] * 5).any()
    long = flown_turn(law, [0.5] * 50)
    assert np.flatnonzero(long == 0.0)[0] == 46


def test_a_seaexplorer_has_its_settings_on_the_rolling_mass():
    model = paper.design_model(full_plant(load_vehicle("seawing")), 1.0)
    law = paper.make_controller("seaexplorer", "switching", model)
    e = math.radians(10.0)
    dive = flown_turn(law, [e, e, e], dt=20.0)
    summed = 20.0 * e * np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(dive, -(0.2 * e + 0.002 * summed))
    np.testing.assert_allclose(
        flown_turn(law, [e, e, e], climbing=True, dt=20.0), -dive
    )
    # 1 deg is in its dead zone, 40 deg count as 15, and 2 deg/s are 30 deg of mass.
    assert not flown_turn(law, [math.radians(1.0)] * 3, dt=20.0).any()
    most = math.radians(15.0)
    assert flown_turn(law, [math.radians(40.0)], dt=20.0)[0] == pytest.approx(
        -0.2 * most - 0.002 * 20.0 * most
    )
    moving = flown_turn(law, [0.0, math.radians(40.0)], dt=20.0)[1]
    assert moving == pytest.approx(-0.24 * most - 15.0 * math.radians(2.0))


LIST = """# settings of comet
sensor: u_hd_fin_ap_gain(1/rad)   1.5
sensor: u_hd_fin_ap_dgain(sec/rad) -4.0  # adds to the turn
u_pitch_max_delta_battpos = 0.2
u_alt_filter_enabled 1
"""


def test_settings_of_an_autopilot_become_gains_and_settings_again(tmp_path):
    file = tmp_path / "autopilot.txt"
    file.write_text(LIST)
    found = read_settings(file, "slocum")
    assert found.unknown == ("u_alt_filter_enabled",)
    numbers = found.gains()["controller"]
    assert numbers["heading_rate_s_rad"] == -4.0
    assert numbers["largest_step_m"] == pytest.approx(0.00508)
    assert settings_of(found.gains(), "gains.toml").values == pytest.approx(
        found.values
    )
    file.write_text(found.text())
    assert read_settings(file, "slocum").values == pytest.approx(found.values)
    file.write_text("$PITCH_GAIN,40.0\n$ROLL_DEG,40\n$C_PITCH,2100\n")
    glider = read_settings(file, "seaglider")
    assert glider.values == {"PITCH_GAIN": 40.0, "ROLL_DEG": 40.0}
    assert glider.unknown == ("C_PITCH",)
    assert glider.text() == "$PITCH_GAIN,40\n$ROLL_DEG,40\n"


SEA_CFG = """# Freq. (sec)
period1=20
period2=0.02

# Heading regulator
heading.deadzone=2
heading.pid.kp=0.2
heading.pid.ki=0.002
heading.pid.kd=15
heading.pid.il=15
heading.pid.el=15
heading.pid.hi=45
heading.pid.lo=-45
heading.pid.ka=0
"""


def test_the_file_of_a_seaexplorer_is_the_law_that_is_flown(tmp_path, capsys):
    """Numbers of a glider at sea: those the law begins with, and back unchanged."""
    file = tmp_path / "sea.cfg"
    file.write_text(SEA_CFG)
    found = read_settings(file, "seaexplorer")
    assert found.unknown == ("period2", "heading.pid.ka")
    law = decode_gains(found.gains(), "switching", COMET.model).controller
    begun = paper.make_controller("seaexplorer", "switching", COMET.model)
    for name in ("period", "dead_zone", "heading_gain", "heading_integral"):
        assert float(getattr(law, name)) == float(getattr(begun, name))
    for name in ("heading_rate", "integral_limit", "largest_error", "largest_angle"):
        assert float(getattr(law, name)) == float(getattr(begun, name))
    kept = [x for x in SEA_CFG.splitlines() if x.split("=")[0] in found.values]
    assert found.text().splitlines() == kept
    assert main(["settings", str(file), "--law", "seaexplorer"]) == 0
    file.with_suffix(".toml").write_text(capsys.readouterr().out)
    assert main(["settings", str(file.with_suffix(".toml"))]) == 0
    assert sorted(capsys.readouterr().out.splitlines()) == sorted(kept)
    file.write_text(SEA_CFG.replace("lo=-45", "lo=-30"))
    with pytest.raises(ConfigError, match=r"heading\.pid\.lo must be -45, for .*hi is"):
        read_settings(file, "seaexplorer")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("u_hd_fin_ap_gain fast", "line 1: u_hd_fin_ap_gain must be a finite number"),
        ("speed 3", "one of u_hd_fin_ap_gain"),
        ("", "none at all"),
    ],
)
def test_settings_that_say_nothing_are_refused(tmp_path, text, complaint):
    file = tmp_path / "autopilot.txt"
    file.write_text(text)
    with pytest.raises(ConfigError, match=complaint):
        read_settings(file, "slocum")


def test_one_command_shows_what_tuning_would_change(tmp_path, capsys):
    flown, tuned = tmp_path / "flown.txt", tmp_path / "tuned.toml"
    flown.write_text(LIST)
    tuned.write_text(
        '[controller]\ntype = "slocum"\nheading_gain_1_rad = 1.1\n'
        "heading_rate_s_rad = 3.0\n"
    )
    assert main(["settings", str(flown), "--gains", str(tuned)]) == 0
    out, err = capsys.readouterr()
    assert "u_alt_filter_enabled" in err
    line = next(x for x in out.splitlines() if x.startswith("u_hd_fin_ap_dgain"))
    assert line.split()[-2:] == ["-4", "3"]
    assert main(["settings", str(flown), "--to", str(tmp_path / "flown.toml")]) == 0
    back = tomllib.loads((tmp_path / "flown.toml").read_text())
    assert back["controller"]["heading_gain_1_rad"] == 1.5
    assert main(["settings", str(tmp_path / "flown.toml"), "--law", "slocum"]) == 0
    assert "u_hd_fin_ap_gain 1.5" in capsys.readouterr().out
