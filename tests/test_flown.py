"""The laws that gliders fly, against their records and their printed numbers."""

from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import paper
from jaxglider.control.flown.battery import ENOUGH, Looks, Shifts, looked, remembered
from jaxglider.control.flown.fin import NEARLY_OVER, Turning, steered
from jaxglider.control.parts import beyond
from jaxglider.vehicle.full_plant import full_plant
from jaxglider.vehicle.published import load_vehicle

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
