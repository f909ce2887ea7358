"""Sweeps of missions that fly yos: how they end, and what they cost."""

import dataclasses
import json

import equinox as eqx
import jax
import netCDF4
import numpy as np
import pytest
from toy_campaign import Toy

import tuning.campaign.execute
import tuning.campaign.report.report
from jaxglider.files.flight.missions import mission_path
from jaxglider.files.mission import load_mission
from jaxglider.guidance.phases import BOTTOM, COMPLETED, STALL, UNFINISHED
from jaxglider.simulation.rollout import evaluate
from tuning.campaign.analysis.summary import ranked
from tuning.campaign.run.rows import (
    ALL_COLUMNS,
    COLUMNS,
    Rows,
    columns_of,
    flatten,
    make_rows,
)
from tuning.evaluation.held_out import _counts
from tuning.evaluation.report import _unfinished
from tuning.reporting.witness import assess

RUN = "sweep --mission slocum-shallow --precision 64 --members 300 --gains mission "
ENERGY, STATUS = (ALL_COLUMNS.index(x) for x in ("flight.energy.steering", "status"))


class Flights(Toy):
    """An engine whose flights are known by the bits of a member."""

    def run(self, members):
        short = super().run(members)
        bits = np.asarray(members.key)[:, 0].astype(np.int64)
        more = len(ALL_COLUMNS) - len(COLUMNS)
        found = np.concatenate([short, np.ones((*short.shape[:2], more))], axis=-1)
        ends = np.array([COMPLETED, COMPLETED, UNFINISHED, BOTTOM, STALL])
        found[:, :, STATUS] = ends[bits % 5][:, None]
        found[:, :, ENERGY] = (bits % 89)[:, None]
        # One in seven never dived: there is nothing to take the mean of.
        dive_time = ALL_COLUMNS.index("flight.dive_time")
        found[bits % 7 == 0, :, dive_time] = np.nan
        return found


@pytest.fixture
def flown(sweep, tmp_path, monkeypatch):
    """The summary and the columns of a sweep, and what it printed."""
    monkeypatch.setattr(tuning.campaign.execute, "Engine", Flights)

    def run(text):
        code, out, complaints = sweep(RUN + text)
        if code == 2:
            return code, out, complaints
        summary = json.loads((tmp_path / "results/sweep/summary.json").read_text())
        with netCDF4.Dataset(tmp_path / "results/sweep/members.nc") as file:
            columns = {
                name: np.asarray(file[f"run_{name.replace('.', '_')}"][:, 0])
                for name in ("finite", "status", *ALL_COLUMNS[len(COLUMNS) + 1 :])
            }
        return code, out, next(iter(summary["controllers"].values())), columns

    return run


def test_what_judges_a_run_has_the_measures_of_its_flight():
    """As the metrics of a rollout have; a row has a place for each."""
    loop = load_mission(mission_path("slocum-shallow")).loop
    sea = loop.scenario.sea(jax.random.key(0))
    judged, seen = jax.eval_shape(assess, loop, sea)
    assert jax.tree.structure(judged) == jax.tree.structure(
        jax.eval_shape(evaluate, loop, sea)
    )
    found = jax.tree.map(lambda x: np.zeros((3, *x.shape)), (judged, seen))
    assert flatten(*found).shape == (3, len(columns_of(flight=True)))


def test_the_verdict_of_tuning_counts_how_missions_ended():
    loop = load_mission(mission_path("slocum-shallow")).loop
    shape, _ = jax.eval_shape(assess, loop, loop.scenario.sea(jax.random.key(0)))
    four = jax.tree.map(lambda x: np.ones((4, *x.shape)), shape)
    ends = np.array([COMPLETED, STALL, BOTTOM, STALL])
    four = eqx.tree_at(
        lambda m: (m.status, m.finite, m.capsized), four, (ends, ends > 0, ends < 0)
    )
    counts = _counts(four, 1, loop.scenario.specification)
    assert (counts.unfinished, counts.ends) == (3, {"bottom": 1, "stall": 2})
    words = _unfinished(dataclasses.asdict(counts))
    assert words == "3 did not finish (1 bottom, 2 stall), "


def test_each_end_of_a_mission_is_counted_and_may_be_required(flown):
    code, out, found, columns = flown(
        "--require p_stall<0.3 p_bottom<0.001 flight.energy.steering.q95<85 "
        "flight.moves.mass_angle.worst<=1 --no-report"
    )
    assert code == 3
    assert "p_stall<0.3: met" in out
    assert "p_bottom<0.001: violated" in out
    assert "flight.moves.mass_angle.worst<=1: violated" in out, "failed runs are worst"
    failed, status = columns["finite"] == 0, columns["status"]
    counted = {
        "p_stall": STALL,
        "p_bottom": BOTTOM,
        "p_hover": -1,
        "p_battery_empty": -1,
    }
    for name, number in counted.items():
        assert found["probabilities"][name]["k"] == np.sum(failed | (status == number))
    unfinished = np.sum(failed | (status != COMPLETED))
    assert found["probabilities"]["p_unfinished"]["k"] == unfinished
    assert "  got no farther" in out
    assert found["ends"]["not finite"] == np.sum(failed)
    assert found["ends"]["stall"] == np.sum(~failed & (status == STALL))
    assert sum(found["ends"].values()) == len(status)
    assert failed[found["worst_member"]]


def test_every_measure_of_a_flight_has_its_mean_and_quantiles(flown):
    _, _, found, columns = flown("--no-report")
    failed = columns["finite"] == 0
    for name in ALL_COLUMNS[len(COLUMNS) + 1 :]:
        assert name in found["measures"]
        worst = np.where(failed, np.inf, columns[name])
        worst = np.sort(worst[~np.isnan(worst)])
        half = found["measures"][name]["q50"]["value"]
        assert half == worst[int(np.ceil(0.5 * len(worst))) - 1]
    assert found["measures"]["flight.energy.steering"]["q05"]["value"] > 0.0


def test_the_report_says_how_missions_ended_and_what_they_cost(
    flown, tmp_path, monkeypatch
):
    monkeypatch.setattr(tuning.campaign.report.report, "_figures", lambda *a: [])
    flown("--uncertainty 0.1")
    text = (tmp_path / "results/sweep/report.md").read_text()
    for part in (
        "## How the missions ended",
        "| completed |",
        "| got no farther |",
        "| energy of the steering [J] |",
        "| did not finish |",
    ):
        assert part in text
    # Nobody tracks a depth.
    likely = text.partition("## How likely is trouble")[2].partition("\n## ")[0]
    assert "| pitch |" in likely
    assert "| depth |" not in likely
    assert "| depth travel [kg] |" in text
    assert "| depth rms error [m] |" not in text


def test_ends_are_refused_where_no_yos_are_flown(sweep):
    code, _, complaints = sweep(
        "sweep --plant printed --controller smc --members 4 --require p_stall<0.1"
    )
    assert code == 2
    assert "no yos are flown that could end early" in complaints


def test_a_mission_that_did_not_come_to_its_end_is_worse_than_any_that_did():
    metrics = np.ones((4, 1, len(ALL_COLUMNS)))
    metrics[:, 0, COLUMNS.index("pitch.funnel_peak")] = [5.0, 3.0, 9.0, 7.0]
    metrics[:, 0, STATUS] = [COMPLETED, STALL, COMPLETED, BOTTOM]
    table = Rows(make_rows(0, np.ones((4, 1)), metrics), ("x",))
    assert ranked(table, 0) == [0, 2, 1, 3]
