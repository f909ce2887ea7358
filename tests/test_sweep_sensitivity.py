"""Who is to blame: estimators against closed forms, gradients against differences."""

import json

import jax
import numpy as np
import pytest
from toy_campaign import RUN

import tuning.campaign.analysis.sensitivity
import tuning.campaign.report.report
from jaxglider.simulation.rollout import evaluate
from jaxglider.uncertainty.members import with_member
from jaxglider.uncertainty.sampling import SobolSequence
from tuning.campaign.analysis.derivatives import gradient_scores
from tuning.campaign.analysis.sensitivity import agreement
from tuning.campaign.analysis.sobol import Saltelli, indices
from tuning.campaign.run.campaign import CampaignSettings, build
from tuning.campaign.run.loop import draw
from tuning.problem.gain_sets import resolve
from tuning.problem.members import SENSITIVITY, SWEEP, keys_of


def ishigami(u, a=7.0, b=0.1):
    x = np.pi * (2.0 * u - 1.0)
    s = np.sin(x)
    return s[:, 0] + a * s[:, 1] ** 2 + b * x[:, 2] ** 4 * s[:, 0]


def test_indices_of_ishigamis_function_are_the_published_ones():
    design = Saltelli(seed=0, columns=3, bases=2048)
    found = indices(ishigami(design.rows(0, 2048 * 5)).reshape(2048, 5))
    # V1 = (1 + b π⁴/5)²/2, V2 = a²/8, V13 = 8 b² π⁸/225.
    v1 = 0.5 * (1.0 + 0.1 * np.pi**4 / 5.0) ** 2
    v2, v13 = 49.0 / 8.0, 8.0 * 0.01 * np.pi**8 / 225.0
    v = v1 + v2 + v13
    np.testing.assert_allclose(found["first"][0], [v1 / v, v2 / v, 0.0], atol=0.02)
    np.testing.assert_allclose(
        found["total"][0], [(v1 + v13) / v, v2 / v, v13 / v], atol=0.02
    )
    assert found["left_out"] == 0


def test_intervals_of_indices_cover():
    # f = x1 + 2 x2, uniform: shares 1/5 and 4/5, first and total alike.
    hits = 0
    for seed in range(60):
        design = Saltelli(seed, 2, 128)
        u = design.rows(0, 128 * 4)
        found = indices((u @ [1.0, 2.0]).reshape(128, 4), seed)
        hits += found["total"][1, 0] <= 0.2 <= found["total"][2, 0]
    # A Sobol sequence does better than independent draws: too wide, never too narrow.
    assert hits >= 54


def test_failed_and_constant_results_are_told():
    results = np.arange(20.0).reshape(4, 5) ** 2
    results[1, 3] = np.inf
    found = indices(results)
    assert (found["blocks"], found["left_out"]) == (3, 1)
    assert indices(np.ones((4, 5)))["total"] is None


def test_blocks_change_one_factor_at_a_time():
    design = Saltelli(seed=3, columns=4, bases=8, chance=True)
    assert design.block == 7
    whole = design.rows(0, 8 * 7)
    blocks = whole.reshape(8, 7, 4)
    points = SobolSequence(3, 8).rows(0, 8)
    np.testing.assert_array_equal(blocks[:, 0], points[:, :4])
    np.testing.assert_array_equal(blocks[:, 1], points[:, 4:])
    for j in range(4):
        changed = blocks[:, 2 + j] != blocks[:, 0]
        assert changed[:, j].all()
        assert changed.sum() == 8
    np.testing.assert_array_equal(blocks[:, 6], blocks[:, 0])
    np.testing.assert_array_equal(design.rows(10, 9), whole[10:19])
    # A, B, four with A's noise, then A with B's noise.
    np.testing.assert_array_equal(
        design.key_numbers(7, 14), [2, 3, 2, 2, 2, 2, 3, 4, 5, 4, 4, 4, 4, 5]
    )


def test_its_runs_are_no_members_of_the_campaign():
    one, other = keys_of(0, SWEEP, range(4)), keys_of(0, SENSITIVITY, range(4))
    assert not np.any(jax.random.key_data(one) == jax.random.key_data(other))


def test_disagreements_are_put_in_words():
    rows = [
        {"quantity": f"q{i}", "rho": -0.9 + 0.05 * i, "total": 0.9 - 0.05 * i}
        for i in range(12)
    ]
    assert agreement(rows)["disagreements"] == []
    assert agreement(rows)["agreement"] == {
        "rank correlation / total index": pytest.approx(1.0)
    }
    rows[0]["rho"] = 0.0
    assert agreement(rows)["disagreements"] == [
        "q0 is number 1 by total index, 12 by rank correlation"
    ]


def test_gradient_scores_are_differences_of_the_rollout():
    campaign = build(
        CampaignSettings(
            scenario="switching",
            plant="printed",
            dt=0.05,
            duration=2.0,
            precision=64,
            seed=5,
            members=8,
            design="monte-carlo",
            uncertainty=0.2,
            gains=resolve(["paper"], ["smc"], "switching", "printed"),
        )
    )
    scores = gradient_scores(campaign, 0, 1)
    member = jax.tree.map(lambda x: x[0], draw(campaign, 0, 1)[1])
    run = jax.jit(lambda m: evaluate(*with_member(campaign.loops[0], m)))
    for name in ("heave_mass", "wave_phase_pitch"):
        place = campaign.uncertainty.names().index(name)
        quantity = campaign.uncertainty.quantities[place]
        sigma = quantity.standard_deviation()
        # Uniform: a width over √12.
        width = 2.0 * np.pi if "phase" in name else 0.4 * abs(quantity.scale)
        assert sigma == pytest.approx(width / np.sqrt(12.0), rel=1e-3)
        ends = []
        for side in (-1e-5, 1e-5):
            values = dict(member.values)
            values[quantity.path] = values[quantity.path] + side * sigma
            ends.append(run(type(member)(values, member.key)).channels)
        for channel in ("depth", "pitch"):
            low, high = (float(getattr(end, channel).rms_error) for end in ends)
            assert scores[f"{channel}.rms_error"][place] == pytest.approx(
                abs(high - low) / 2e-5, rel=1e-3, abs=1e-12
            )


def test_a_sweep_says_what_is_to_blame(sweep, tmp_path, monkeypatch):
    monkeypatch.setattr(
        tuning.campaign.analysis.sensitivity, "gradient_scores", lambda *a: {}
    )
    monkeypatch.setattr(tuning.campaign.report.report, "ribbons", None)
    code, out, _ = sweep(RUN + "--members 40 --sensitivity 16 --out a --json")
    assert code == 0
    found = json.loads(out)["controllers"]["smc"]["sensitivity"]
    rows = found["left_funnel"]["rows"]
    assert found["left_funnel"]["blocks"] == 16
    # The toy leaves by its key alone: no number is to blame.
    assert {row["total"] for row in rows} == {0.0}
    assert all(row["total_interval"] == [0.0, 0.0] for row in rows)
    before = (tmp_path / "a/sobol.bin").read_bytes()
    # More blocks go on from those that are there.
    assert sweep(RUN + "--members 40 --sensitivity 32 --out a --resume")[0] == 0
    after = (tmp_path / "a/sobol.bin").read_bytes()
    assert len(after) == 2 * len(before)
    assert after[: len(before)] == before
    code, _, err = sweep(RUN + "--members 40 --sensitivity 8 --shard 1/2 --out b")
    assert code == 2
    assert "--sensitivity does not go with --shard" in err
