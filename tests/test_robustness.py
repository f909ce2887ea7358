"""Figures that the tick or roundings decide are said to be so."""

import dataclasses

import jax
import pytest

from jaxglider import Clock, paper
from tuning.evaluation.held_out import Judge
from tuning.evaluation.robustness import (
    STARTS,
    judge_robustness,
    robustness,
    with_tick,
)
from tuning.evaluation.sections import robust_section, specified_section
from tuning.problem.problem import TuningProblem
from tuning.problem.spec import EnsembleSpec, ProblemSpec


def figures(heading, depth=0.1):
    of = {"depth": depth, "pitch": 0.2, "heading": heading}
    return {"nominal": of, "held_out": {**of, "heading": 0.3}}


def test_a_figure_that_roundings_decide_is_marked_with_its_interval():
    # A published pair of the kind: 0.080 to 0.298 from starts 1e-10 m apart.
    starts = [figures(x) for x in (0.1, 0.08, 0.298, 0.12)]
    found = robustness(starts, {"0.05": starts[0]})
    assert found.not_reproducible == ("nominal.heading",)
    assert found.roundings["nominal"]["heading"] == [0.08, 0.298]
    (remark,) = found.remarks()
    assert remark.startswith(
        "not reproducible: heading rms error, nominal case, is 0.08"
    )
    assert "0.298 rad from starts 1e-10 m apart" in remark


def test_a_figure_that_the_tick_decides_is_marked():
    ticks = {
        t: figures(x) for t, x in (("0.025", 0.788), ("0.05", 0.201), ("0.1", 0.365))
    }
    found = robustness([ticks["0.05"]] * 3, ticks)
    assert found.not_reproducible == ()
    assert found.tick_dependent == ("nominal.heading",)
    (remark,) = found.remarks()
    assert "0.788 at 0.025 s, 0.201 at 0.05 s, 0.365 at 0.1 s" in remark


def test_what_rests_on_neither_is_not_marked():
    starts = [figures(x) for x in (0.1, 0.1001, 0.0999)]
    found = robustness(starts, {"0.05": starts[0], "0.1": figures(0.12)})
    assert found.remarks() == []
    missing = robustness([figures(None), figures(0.1)], {"0.05": figures(None)})
    assert missing.roundings["nominal"]["heading"] is None
    assert missing.remarks() == []


def test_another_tick_keeps_the_horizon():
    loop = paper.make_loop("switching", "printed", "smc", duration=3.0)
    for factor, ticks in ((0.5, 120), (2.0, 30)):
        clock = with_tick(loop, factor).scenario.clock
        assert clock.ticks == ticks
        assert float(clock.dt) * ticks == pytest.approx(3.0)


def test_a_short_stable_run_is_reproducible_and_figures_are_those_of_its_ticks(
    evaluate_jit,
):
    loop = paper.make_loop("switching", "printed", "smc", duration=3.0)
    ensemble = EnsembleSpec(0.2, training=2, validation=2, test=3)
    problem = TuningProblem.of(ProblemSpec.of_loop(loop, ensemble=ensemble))
    found = judge_robustness(Judge(problem), problem.loop)
    assert list(found.ticks) == ["0.025", "0.05", "0.1"]
    assert found.remarks() == []
    assert len(STARTS) == 4
    scenario = dataclasses.replace(problem.loop.scenario, clock=Clock(30, 0.1))
    coarse = dataclasses.replace(problem.loop, scenario=scenario)
    # The paper's sea has no chance in it.
    nominal = evaluate_jit(coarse, scenario.sea(jax.random.key(0)))
    for channel, of in vars(nominal.channels).items():
        assert found.ticks["0.1"]["nominal"][channel] == pytest.approx(
            float(of.rms_error), rel=1e-9
        )
    assert found.ticks["0.1"]["held_out"] != found.ticks["0.05"]["held_out"]


def test_the_report_has_a_table_of_ticks_and_roundings():
    ticks = {t: figures(x) for t, x in (("0.05", 0.2), ("0.1", 0.4))}
    of = robustness([ticks["0.05"], figures(0.3)], ticks).to_dict()
    lines = robust_section(of)
    assert "| heading [rad] | 0.2 | 0.3 | 0.05 |" in lines
    assert "| heading [rad] | 0.4 | 0.3 | 0.1 |" in lines
    assert "| heading [rad] | 0.2 to 0.3 | 0.3 to 0.3 | roundings |" in lines
    assert robust_section(None) == []
    counts = {"after": {"members": 4, "broken": {"any": 2, "bank": 1}}}
    assert "| after | 2 of 4 | 1 of 4 |" in specified_section(counts)
