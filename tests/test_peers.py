"""The closed loop in C and in NumPy says the same as jaxglider."""

import dataclasses
import shutil
import sys
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

from jaxglider import evaluate, map_members, paper
from jaxglider.vehicle.parameters import GliderParameters

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from peers import c, numpy_loop
from peers.problem import METRICS, Problem, draw_members, metric_rows, parameter_rows

TICKS, MEMBERS = 700, 19
SURGE_MASS = [f.name for f in dataclasses.fields(GliderParameters)].index("surge_mass")

compiler = pytest.mark.skipif(
    shutil.which(c.COMPILER) is None, reason=f"no C compiler {c.COMPILER}"
)


@pytest.fixture(scope="module")
def flown():
    """Loop, sea, members and jaxglider's metrics.

    With settling times cut to 0.3 some members leave a funnel and roll over within
    35 s, so every branch is taken; 19 members leave the last block of lanes half empty.
    """
    loop = paper.make_loop("switching", duration=TICKS * 0.05)
    at = lambda x: [
        p.settling_time for p in vars(x.controller.funnel.performance).values()
    ]
    loop = eqx.tree_at(at, loop, [t * 0.3 for t in at(loop)])
    # Judged by this funnel, not by what the case specifies.
    scenario = dataclasses.replace(loop.scenario, specification=None)
    loop = dataclasses.replace(loop, scenario=scenario)
    sea = loop.scenario.sea(jax.random.key(0))
    members = draw_members(loop.scenario.plant.parameters, MEMBERS, 64)

    def member(parameters):
        where = lambda at: at.scenario.plant.parameters
        return evaluate(eqx.tree_at(where, loop, parameters), sea)

    metrics = jax.jit(lambda x: map_members(member, x))(members)
    return loop, sea, members, metric_rows(metrics)


def problem(flown, kind):
    loop, sea, members, _ = flown
    return Problem.of(loop, sea, kind), parameter_rows(members, kind)


def close(found, reference, relative, absolute):
    """Largest difference of each metric over what is allowed; names those above one."""
    allowed = relative * np.abs(reference) + absolute
    worst = np.max(np.abs(found - reference) / allowed, axis=1)
    return {n: float(w) for n, w in zip(METRICS, worst, strict=True) if not w <= 1.0}


def test_the_case_exercises_what_is_compared(flown):
    reference = dict(zip(METRICS, flown[3], strict=True))
    for name in ("depth.max_error_settled", "pitch.time_outside_funnel"):
        assert np.max(reference[name]) > 0.0, name
    saturated = [
        reference[f"{c}.time_saturated"] for c in ("depth", "pitch", "heading")
    ]
    assert np.max(saturated) > 0.0
    assert np.std(reference["pitch.rms_error"]) > 1e-4


def test_numpy_agrees_to_rounding(flown):
    found = numpy_loop.evaluate(*problem(flown, np.float64), TICKS)
    assert not close(found, flown[3], 1e-9, 1e-12)


@compiler
@pytest.mark.parametrize("flags", [c.FAST, c.PLAIN], ids=["best", "plain"])
def test_c_agrees_to_rounding(flown, flags):
    found = c.evaluate(*problem(flown, np.float64), TICKS, 2, flags)
    assert not close(found, flown[3], 1e-9, 1e-12)


@compiler
def test_c_agrees_in_single_precision_and_member_by_member(flown):
    shared, rows = problem(flown, np.float32)
    found = c.evaluate(shared, rows, TICKS)
    assert found.dtype == np.float32
    assert not close(found, flown[3], 1e-3, 1e-5 + 1.001 / TICKS)
    alone = c.evaluate(shared, np.ascontiguousarray(rows[:, 7:8]), TICKS)
    assert not close(alone, found[:, 7:8], 1e-3, 1e-5 + 1.001 / TICKS)


@compiler
def test_a_wrong_gain_is_noticed(flown):
    shared, rows = problem(flown, np.float64)
    shared.shared["k2"][2] *= 1.0001
    found = c.evaluate(shared, rows, TICKS, 1, c.PLAIN)
    assert "heading.rms_error" in close(found, flown[3], 1e-9, 1e-12)


@compiler
def test_a_diverging_member_is_reported_as_not_finite(flown):
    shared, rows = problem(flown, np.float64)
    rows[SURGE_MASS, 3] = np.nan
    found = dict(zip(METRICS, c.evaluate(shared, rows, TICKS, 1, c.PLAIN), strict=True))
    assert found["finite"].tolist() == [float(i != 3) for i in range(MEMBERS)]


def test_missing_compiler_and_refused_flag_are_named(monkeypatch):
    monkeypatch.setattr(c, "COMPILER", "no-such-compiler")
    with pytest.raises(c.CompilerError, match="no-such-compiler"):
        c.library(("-O1",), 64, 1)
    if shutil.which("gcc"):
        monkeypatch.setattr(c, "COMPILER", "gcc")
        with pytest.raises(c.CompilerError, match="no-such-flag"):
            c.library(("-fno-such-flag",), 64, 1)


@compiler
def test_the_program_in_c_leaves_the_arithmetic_of_the_process_alone(flown):
    c.evaluate(*problem(flown, np.float32), TICKS)
    assert np.float64(5e-324) * 1.0 > 0.0
