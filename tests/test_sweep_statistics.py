"""Intervals that cover what they say, checked against exact laws and by repetition."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from jaxglider.signals import CHANNELS
from tuning.campaign.analysis.rank_correlations import rank_correlations
from tuning.campaign.analysis.summary import CampaignSummary, ControllerSummary
from tuning.campaign.report.names import with_unit
from tuning.campaign.report.report import _driven
from tuning.campaign.report.sensitivity_section import LEAST_BLOCKS, blamed
from tuning.campaign.report.text import LINES, brackets, text_summary
from tuning.campaign.run.rows import unit
from tuning.reporting.statistics import (
    clopper_pearson,
    cvar,
    discordant,
    paired_difference,
    probability,
    quantile,
    spread,
    student_half_width,
)


@pytest.mark.parametrize(
    ("k", "n", "interval"),
    [
        # Closed forms at the ends: 1 − (α/2)^(1/n).
        (0, 10, (0.0, 1.0 - 0.025**0.1)),
        (10, 10, (0.025**0.1, 1.0)),
        # Clopper and Pearson's own table, two digits: 5 of 10.
        (5, 10, (0.187086, 0.812914)),
    ],
)
def test_exact_interval_against_closed_forms_and_the_published_table(k, n, interval):
    assert clopper_pearson(k, n) == pytest.approx(interval, abs=1e-6)


@pytest.mark.parametrize(("n", "p"), [(20, 0.1), (200, 0.02), (500, 0.37)])
def test_exact_interval_covers_at_least_what_it_says(n, p):
    # Summed over the binomial law itself: no sampling error.
    k = np.arange(n + 1)
    inside = [low <= p <= high for low, high in (clopper_pearson(int(j), n) for j in k)]
    covered = float(np.sum(stats.binom.pmf(k, n, p)[inside]))
    assert 0.95 <= covered <= 0.99


def test_exact_interval_covers_a_toy_of_known_probability():
    # A cheap model: a uniform number leaves its funnel when above 0.9.
    rng = np.random.default_rng(0)
    repeats, n = 4000, 300
    events = rng.random((repeats, n)) > 0.9
    hits = 0
    for row in events:
        low, high = probability(row)["interval"]
        hits += low <= 0.1 <= high
    # Five standard deviations of the repetition are 1.7 %.
    exact = _exact_coverage(n, 0.1)
    assert exact >= 0.95
    assert hits / repeats == pytest.approx(exact, abs=0.017)


def _exact_coverage(n, p):
    k = np.arange(n + 1)
    inside = [a <= p <= b for a, b in (clopper_pearson(int(j), n) for j in k)]
    return float(np.sum(stats.binom.pmf(k, n, p)[inside]))


@pytest.mark.parametrize("bad", [(-1, 10), (11, 10), (0, 0)])
def test_counts_that_are_none_are_refused(bad):
    with pytest.raises(ValueError, match="successes must be in"):
        clopper_pearson(*bad)


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_quantile_intervals_cover_whatever_the_law(share):
    rng = np.random.default_rng(1)
    truth = stats.expon.ppf(share)
    repeats, hits = 2000, 0
    for row in rng.exponential(size=(repeats, 200)):
        low, high = quantile(row, share)["interval"]
        hits += low <= truth <= high
    assert 0.945 <= hits / repeats <= 0.985


def test_a_quantile_that_the_members_are_too_few_for_has_an_open_end():
    found = quantile(np.arange(20.0), 0.99)
    assert found["value"] == 19.0
    assert found["interval"][1] is None
    assert quantile(np.arange(20.0), 0.05)["interval"][0] is None


def test_cvar_of_a_known_law_and_its_coverage():
    # Of the exponential law: 1 − ln(0.05) at 5 %.
    truth = 1.0 - np.log(0.05)
    rng = np.random.default_rng(2)
    assert cvar(rng.exponential(size=400_000))["value"] == pytest.approx(
        truth, rel=0.01
    )
    hits = 0
    for row in rng.exponential(size=(500, 2000)):
        low, high = cvar(row)["interval"]
        hits += low <= truth <= high
    assert 0.9 <= hits / 500 <= 0.98


def test_a_failed_run_is_the_worst_of_all_and_never_left_out():
    values = np.array([1.0, 2.0, 3.0, np.inf])
    found = spread(values)
    assert found["mean"] is None
    assert found["worst"] is None
    assert found["cvar95"]["value"] is None
    assert found["q50"]["value"] == 2.0


def test_paired_comparison_by_hand():
    first = np.array([1.0, 2.0, 3.0, np.inf, np.inf])
    second = np.array([0.5, 2.5, 1.0, 1.0, np.inf])
    found = paired_difference(first, second)
    assert found["pairs"] == 3
    assert found["difference"] == pytest.approx(-2.0 / 3.0)
    assert (found["wins"], found["losses"], found["ties"]) == (3, 1, 1)
    assert found["win_rate"] == 0.75
    assert found["win_interval"] == list(clopper_pearson(3, 4))
    test = stats.ttest_1samp([-0.5, 0.5, -2.0], 0.0)
    assert found["interval"] == pytest.approx(list(test.confidence_interval(0.95)))


def test_discordant_pairs_by_hand():
    first = np.array([True, True, True, False, False])
    second = np.array([False, False, False, False, True])
    found = discordant(first, second)
    assert (found["only_first"], found["only_second"]) == (3, 1)
    assert found["difference"] == pytest.approx(-0.4)
    # Two-sided binomial: 2 (1 + 4)/16.
    assert found["p_value"] == pytest.approx(0.625)


def test_cells_of_the_summary_keep_apart_however_long_they_are():
    found = {"p": 5e-4, "interval": [1.266e-05, 2.783e-03]}
    value = {"value": 0.1, "interval": [0.09, 0.11]}
    gains = ControllerSummary(
        kind="fxtppc",
        origin="paper",
        probabilities=dict.fromkeys(LINES, found),
        failed_members=[],
        worst_member=1,
        median_member=2,
        measures={f"{channel}.rms_error": {"q95": value} for channel in CHANNELS},
    )
    summary = CampaignSummary(
        scenario="waypoints",
        plant="rigid-body",
        has_waypoints=True,
        precision=32,
        design="monte-carlo",
        seed=0,
        uncertainty=0.2,
        members=2000,
        members_asked_for=2000,
        confidence=0.95,
        controllers={
            "fxtppc": gains,
            "fxtppc (tuned)": dataclasses.replace(gains, not_flown=3),
        },
        paired=[],
    )
    lines = text_summary(summary).splitlines()
    cell = "0.0005 [1.266e-05, 0.002783]"
    (row,) = (line for line in lines if line.startswith("did not finish"))
    assert row.split(maxsplit=3)[3] == f"{cell}  {cell}"
    (remark,) = (line for line in lines if "flew nothing" in line)
    assert remark.startswith("fxtppc (tuned): 3 members")
    assert not [line for line in lines if line != line.rstrip()]


@pytest.mark.parametrize("n", [2, 10, 59, 1500])
def test_quantiles_and_tests_are_those_of_scipys_statistics(n):
    rng = np.random.default_rng(n)
    for share in (0.05, 0.5, 0.99):
        law = stats.binom(n, share)
        low, high = int(law.ppf(0.025)), int(law.ppf(0.975)) + 1
        ends = [float(low - 1) if low else None, float(high - 1) if high <= n else None]
        assert quantile(np.arange(float(n)), share)["interval"] == ends
    for k in {1, max(n // 3, 1), n - 1}:
        found = clopper_pearson(k, n)
        wanted = [stats.beta.ppf(0.025, k, n - k + 1)]
        wanted += [stats.beta.ppf(0.975, k + 1, n - k)]
        np.testing.assert_allclose(found, wanted, rtol=1e-10)
        first = np.arange(n) < k
        p = stats.binomtest(k, n).pvalue
        assert discordant(first, ~first)["p_value"] == pytest.approx(p, rel=1e-10)
    x = rng.normal(size=n)
    half = stats.t.ppf(0.975, n - 1) * stats.sem(x)
    assert student_half_width(x) == pytest.approx(half, rel=1e-10)
    tied = rng.integers(0, 5, (n, 3)).astype(float)
    found = rank_correlations(tied, x)["rho"]
    for column, rho in zip(tied.T, found, strict=True):
        if np.ptp(column) > 0.0:
            assert rho == pytest.approx(stats.spearmanr(column, x).statistic)


def test_a_measure_that_some_runs_do_not_have_is_that_of_the_others():
    """A run that ended before its funnel settled is neither good nor bad."""
    values = np.arange(40.0)
    with_gaps = np.concatenate([values, np.full(7, np.nan)])
    assert spread(with_gaps) == spread(values)
    nothing = spread(np.full(3, np.nan))
    assert nothing["mean"] is nothing["worst"] is nothing["q95"]["value"] is None


def test_intervals_that_cannot_be_had_are_said_in_words():
    assert brackets([None, None]) == "[too few members]"
    assert brackets([0.25, None]) == "[0.25, no bound]"
    assert brackets([0.25, 0.5]) == "[0.25, 0.5]"


@pytest.mark.parametrize("blocks", [LEAST_BLOCKS - 1, LEAST_BLOCKS])
def test_sobol_indices_of_too_few_blocks_are_withheld(blocks):
    number = {"quantity": "drag", "rho": 0.5}
    number |= {name: 0.75 for name in ("total", "first")}
    number |= {f"{name}_interval": [0.5, 1.0] for name in ("total", "first")}
    one = {"blocks": blocks, "rows": [number], "agreement": {}, "disagreements": []}
    one |= {"blocks_left_out": 0}
    law = SimpleNamespace(sensitivity={"severity": one})
    page = "\n".join(blamed(SimpleNamespace(controllers={"a": law})))
    few = blocks < LEAST_BLOCKS
    assert ("withheld" in page) == few
    assert ("0.75 [0.5, 1]" in page) == (not few)


def test_results_have_their_own_unit_and_forces_that_of_their_axis():
    angles = ["max_roll", "max_pitch"]
    assert [unit(name) for name in angles] == ["rad", "rad"]
    assert unit("end_time") == "s"
    assert unit("largest_disturbance_roll") == "N m"
    assert unit("largest_disturbance_surge") == "N"
    assert unit("pitch.travel") == "m"


def test_a_result_that_is_the_same_in_every_member_has_no_driver():
    values = np.random.default_rng(0).normal(size=(20, 1))
    ranked = {}
    for name, result in (("max_roll", values[:, 0]), ("left_funnel", np.ones(20))):
        rho = rank_correlations(values, result)["rho"][0]
        ranked[name] = [{"quantity": "drag", "rho": rho}]
    law = SimpleNamespace(rank_correlations=ranked | {"severity": []})
    rows = "\n".join(_driven(SimpleNamespace(controllers={"a": law}))).split("\n")
    assert "| a | largest roll | drag +1.00 |" in rows
    assert "| a | leaving a specified funnel | the same in every member |" in rows
    assert "| a | severity | - |" in rows


def test_measures_in_tables_have_words_and_units():
    assert with_unit("max_roll") == "largest roll [rad]"
    assert with_unit("depth.travel") == "depth travel [kg]"
    assert with_unit("severity") == "severity"
    assert with_unit("flight.strokes") == "strokes of the pump"
    assert with_unit("flight.energy_per_made_good") == "energy per way made good [J/m]"
