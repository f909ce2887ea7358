"""A sweep judges the specification whole, and finds the level at which it stops."""

import json

import numpy as np
import pytest
from toy_campaign import RUN, Toy

import tuning.campaign.execute
from jaxglider.vehicle.published import load_vehicle
from tuning.campaign.analysis.bisection import Threshold, find_threshold
from tuning.campaign.analysis.requirements import requirement
from tuning.campaign.run.rows import COLUMNS, flatten, metrics_and_witness
from tuning.reporting.statistics import bonferroni, clopper_pearson

PATH = "plant.parameters.yaw_inertia"
INERTIA = 20.4 / 0.8
EDGE = 0.1


class Edgy(Toy):
    """Runs that leave the heading's funnel where an inertia is a tenth off.

    With members even in ±h the probability is 1 − 0.1/h, and 0 up to h = 0.1.
    """

    def run(self, members):
        found = super().run(members)
        found[:, :, COLUMNS.index("finite")] = 1.0
        found = np.nan_to_num(found)
        off = np.abs(np.asarray(members.values[PATH]) / INERTIA - 1.0)
        for name in ("depth", "pitch", "heading"):
            outside = (off > EDGE) & (name == "heading")
            column = COLUMNS.index(f"{name}.time_outside_funnel")
            found[:, :, column] = outside[:, None]
        found[:, :, COLUMNS.index("capsized")] = 0.0
        return found


def test_the_inertia_is_that_of_the_vehicle():
    found = float(load_vehicle("seawing").parameters.yaw_inertia)
    assert found == pytest.approx(INERTIA, rel=1e-12)


@pytest.mark.parametrize("stops", [0.013, 0.11, 0.29])
def test_a_bisection_brackets_where_it_stops(stops):
    tried = []

    def holds(level):
        tried.append(level)
        return level < stops

    found = find_threshold(holds, 0.32, 0.01)
    assert found.holds_at < stops <= found.fails_at
    assert found.fails_at - found.holds_at <= 0.0101
    assert len(tried) == len(set(tried)) <= 7


def test_a_bisection_says_where_it_holds_everywhere_or_nowhere():
    assert find_threshold(lambda _: True, 0.2, 0.01) == Threshold(0.2, None)
    assert find_threshold(lambda _: False, 0.2, 0.01) == Threshold(None, 0.01)


def test_simultaneous_intervals_cover_all_parts_at_once():
    """Of parts with known and dependent probabilities, more often than each alone."""
    rng = np.random.default_rng(0)
    known, level, runs, members = np.array([0.02, 0.05, 0.3, 0.32]), 0.9, 2000, 150
    each = bonferroni(level, len(known))
    assert each == pytest.approx(0.975)
    together, alone = 0, 0
    for _ in range(runs):
        # One uniform number for two parts, another for the other two.
        u = rng.uniform(size=(members, 2))[:, [0, 0, 1, 1]]
        counts = (u < known).sum(axis=0)
        for of, sums in ((each, "together"), (level, "alone")):
            ends = [clopper_pearson(int(k), members, of) for k in counts]
            hit = all(a <= p <= b for (a, b), p in zip(ends, known, strict=True))
            together += hit and sums == "together"
            alone += hit and sums == "alone"
    assert together / runs >= level
    assert alone < together


@pytest.mark.parametrize("text", ["spec", "spec<0.05", "smc:spec"])
def test_the_whole_specification_is_a_requirement(text):
    rule = requirement(text)
    assert (rule.quantity, rule.comparison, rule.limit) == ("spec", "<", 0.05)
    assert rule.label == ("smc" if ":" in text else "")


def test_a_sweep_judges_the_specification_whole(sweep, monkeypatch, tmp_path):
    monkeypatch.setattr(tuning.campaign.execute, "Engine", Edgy)
    words = "--members 400 --uncertainty 0.2 --require spec<0.7 spec<0.5 --json "
    code, out, _ = sweep(RUN + words + "--out one")
    assert code == 3
    found = json.loads(out)
    broken = found["controllers"]["smc"]["broken"]
    # The printed plant has no bank limit.
    assert set(broken) == {"any", "depth", "pitch", "heading"}
    assert broken["heading"]["p"] == pytest.approx(0.5, abs=0.1)
    assert broken["any"] == broken["heading"]
    low, high = broken["any"]["interval"]
    wide = broken["any"]["simultaneous"]
    assert wide[0] < low < high < wide[1]
    met, missed = found["requirements"]
    assert met["verdict"] == "met"
    assert missed["verdict"] != "met"
    assert met["interval"] == wide
    assert met["correction"] == "Bonferroni, 4 intervals"
    # The law ignores funnels and has no observer.
    ledger = found["controllers"]["smc"]["ledger"]
    assert set(ledger) == {"unsaturated", "tick"}
    assert ledger["tick"]["holds"]["k"] == 400


def test_a_sweep_finds_the_level_at_which_it_stops(sweep, monkeypatch, tmp_path):
    monkeypatch.setattr(tuning.campaign.execute, "Engine", Edgy)
    words = "--members 600 --uncertainty 0.32 --require spec<0.3 --find-level --json "
    code, out, _ = sweep(RUN.replace("--no-report ", "") + words + "--out many")
    assert code == 0
    result = json.loads(out)
    # Met where the interval's end is below 0.3: p is then about 0.25, at 0.133.
    threshold = result["specification"]
    assert threshold["fails_at"] - threshold["holds_at"] == pytest.approx(
        0.01, abs=1e-3
    )
    assert EDGE < threshold["holds_at"] < EDGE / 0.7
    levels = [level["uncertainty"] for level in result["levels"]]
    assert levels == sorted(levels)
    shares = [x["controllers"]["smc"]["broken"]["any"]["p"] for x in result["levels"]]
    assert shares == sorted(shares)
    report = (tmp_path / "many" / "report.md").read_text()
    assert "holds at" in report
    assert (tmp_path / "many" / "specification.png").stat().st_size > 5000


@pytest.mark.parametrize(
    "words", ["--find-level", "--require spec --find-level --uncertainty 0.1 0.2"]
)
def test_what_a_search_for_a_level_needs_is_said(sweep, words):
    code, _, err = sweep(RUN + "--members 4 --out never " + words)
    assert code == 2
    assert "--find-level goes with --require spec" in err


def test_rows_give_back_metrics_and_witness():
    values = np.arange(2.0 * len(COLUMNS)).reshape(2, -1)
    metrics, witness = metrics_and_witness(values)
    assert metrics.finite.tolist() == [False, False]
    back = flatten(metrics, witness)
    same = [n for n, name in enumerate(COLUMNS) if name not in ("finite", "capsized")]
    np.testing.assert_array_equal(back[:, same], values[:, same])
