"""Campaigns: members that depend on nothing but their number, rows that survive."""

import dataclasses
import json
import re
import resource

import jax
import netCDF4
import numpy as np
import pytest
import xarray
from cf_checker import complaints
from html_page import mailable
from scipy import stats
from toy_campaign import RUN, Toy

import tuning.campaign.execute
import tuning.campaign.report.conclude
import tuning.campaign.report.report
from jaxglider.signals import CHANNELS
from jaxglider.simulation.rollout import simulate
from jaxglider.uncertainty.members import with_member
from tuning.campaign.analysis.rank_correlations import rank_correlations
from tuning.campaign.analysis.ribbons import Ribbons, ribbons
from tuning.campaign.run.campaign import CampaignSettings, build
from tuning.campaign.run.engine import Engine
from tuning.campaign.run.loop import STEP, compute, draw
from tuning.campaign.run.rows import (
    COLUMNS,
    METRIC_COLUMNS,
    Rows,
    flatten,
    make_rows,
)
from tuning.campaign.run.store import Store, StoreFull, read_manifest, read_rows
from tuning.problem.gain_sets import resolve

SETTINGS = CampaignSettings(
    scenario="switching",
    plant="printed",
    dt=0.05,
    duration=2.0,
    precision=64,
    seed=5,
    members=4 * STEP,
    design="monte-carlo",
    uncertainty=0.2,
    gains=resolve(["paper"], ["smc"], "switching", "printed"),
)


@pytest.fixture(scope="module")
def campaign():
    return build(SETTINGS)


@pytest.fixture(scope="module")
def engines(campaign):
    example = draw(campaign, 0, 1)[1]
    devices = jax.local_devices()[:2]
    both = Engine(campaign.loops, example, devices, piece=4)
    return Engine(campaign.loops, example, devices[:1], piece=4), both


def test_a_member_depends_on_seed_and_number_alone(campaign, engines):
    one, two = engines
    whole = compute(campaign, one, 0, 11)
    assert len({row.tobytes() for row in whole["values"]}) == 11
    # On two devices, in other chunks, from the middle on, and alone.
    assert compute(campaign, two, 0, 11).tobytes() == whole.tobytes()
    parts = [compute(campaign, two, a, b - a) for a, b in ((0, 3), (3, 10), (10, 11))]
    assert np.concatenate(parts).tobytes() == whole.tobytes()
    assert compute(campaign, one, 7, 1).tobytes() == whole[7:8].tobytes()


@pytest.fixture(scope="module")
def alone(campaign):
    """The whole run of one member, by its number."""
    run = jax.jit(lambda member: simulate(*with_member(campaign.loops[0], member)))
    return lambda n: run(jax.tree.map(lambda x: x[0], draw(campaign, n, 1)[1]))


def test_a_row_is_what_the_rollout_of_that_member_gives(campaign, engines, alone):
    rows = compute(campaign, engines[0], 2, 3)
    metrics = alone(3).metrics
    found = dict(zip(COLUMNS, rows["metrics"][1, 0], strict=True))
    assert found["depth.rms_error"] > 0.0
    kept = rows["metrics"][1, 0, : len(METRIC_COLUMNS)]
    np.testing.assert_allclose(kept, flatten(metrics), rtol=1e-9)
    assert found["pitch.chattering"] == pytest.approx(
        float(metrics.channels.pitch.chattering), rel=1e-9
    )
    assert found["finite"] == float(metrics.finite) == 1.0


def test_a_campaign_says_what_its_rows_hold(sweep, tmp_path):
    code, out, err = sweep(RUN + "--members 1200 --out a --json")
    assert code == 0
    summary = json.loads(out)
    assert summary == json.loads((tmp_path / "a/summary.json").read_text())
    rows = read_rows(tmp_path / "a/rows.bin", read_manifest(tmp_path / "a").row_type())
    failed = ~(rows["metrics"][:, 0, COLUMNS.index("finite")] == 1.0)
    left = rows["metrics"][:, 0, COLUMNS.index("depth.time_outside_funnel")] > 0.0
    found = summary["controllers"]["smc"]
    assert found["failed_members"] == np.flatnonzero(failed).tolist()
    assert 1 <= len(found["failed_members"]) < 100
    chances = found["probabilities"]
    # A run that failed counts as every kind of trouble.
    assert chances["p_violation"]["k"] == np.sum(left | failed)
    assert chances["p_violation_heading"]["k"] == failed.sum()
    assert chances["p_capsize"]["k"] == chances["p_failure"]["k"] == failed.sum()
    assert chances["p_violation"]["n"] == 1200
    assert found["worst_member"] in found["failed_members"]
    assert found["measures"]["pitch.rms_error"]["worst"] is None
    assert found["measures"]["pitch.rms_error"]["q50"]["value"] is not None
    assert "1200 members" in err
    with netCDF4.Dataset(tmp_path / "a/members.nc") as file:
        assert file.dimensions["member"].size == 1200
        np.testing.assert_array_equal(file["drag"][:], rows["values"][:, _drag(file)])
        assert file["drag"].units == "kg/m"
        assert np.isnan(file["run_pitch_rms_effort"][failed, 0].filled(np.nan)).all()
        np.testing.assert_array_equal(file["run_finite"][:, 0] == 0, failed)


def test_the_checker_of_the_conventions_finds_nothing(sweep, tmp_path):
    """With every quantity that can be uncertain, and two sets of gains."""
    assert sweep("init --uncertainty u.toml")[0] == 0
    told = RUN.replace("--controller smc", "--controller smc ppc")
    assert sweep(f"{told} --members 8 --uncertainty u.toml --out a")[0] == 0
    assert complaints(tmp_path / "a/members.nc") == []
    with xarray.open_dataset(tmp_path / "a/members.nc") as data:
        assert data["run_end_time"].dims == ("member", "gains")
        assert data["gains_name"].values.tolist() == ["smc", "ppc"]


def _drag(file):
    names = [n for n, v in file.variables.items() if "drawn value" in v.long_name]
    return names.index("drag")


@pytest.mark.parametrize("design", ["latin-hypercube", "sobol"])
def test_shards_of_every_design_are_the_whole(sweep, tmp_path, design):
    base = RUN + f"--members 600 --design {design} --out "
    for name, more in (("whole", ""), ("s1", " --shard 1/2"), ("s2", " --shard 2/2")):
        assert sweep(base + name + more)[0] == 0
    first, second, whole = (
        (tmp_path / name / "rows.bin").read_bytes() for name in ("s1", "s2", "whole")
    )
    assert first + second == whole
    assert sweep(RUN + "--members 600 --out random")[0] == 0
    assert (tmp_path / "random/rows.bin").read_bytes() != whole


def test_shards_and_resumed_campaigns_have_the_rows_of_the_whole(
    sweep, tmp_path, monkeypatch
):
    assert sweep(RUN + "--members 1500 --out whole")[0] == 0
    whole = (tmp_path / "whole/rows.bin").read_bytes()
    for i in (1, 2, 3):
        assert sweep(RUN + f"--members 1500 --out s{i} --shard {i}/3")[0] == 0
    parts = [(tmp_path / f"s{i}/rows.bin").read_bytes() for i in (1, 2, 3)]
    assert b"".join(parts) == whole

    class Interrupted(Toy):
        def run(self, members):
            if np.asarray(members.key).shape[0] != STEP:
                raise KeyboardInterrupt
            return super().run(members)

    monkeypatch.setattr(tuning.campaign.execute, "Engine", Interrupted)
    code, _, err = sweep(RUN + "--members 1500 --out cut")
    assert code == 130
    assert "1024 members are safe" in err
    assert json.loads((tmp_path / "cut/summary.json").read_text())["members"] == 1024
    # What a crash may leave: half a row at the end, and one whose bits are wrong.
    file = tmp_path / "cut/rows.bin"
    size = read_manifest(tmp_path / "cut").row_type().itemsize
    broken = bytearray(file.read_bytes() + whole[:100])
    broken[1000 * size + 40] ^= 1
    file.write_bytes(broken)
    monkeypatch.setattr(tuning.campaign.execute, "Engine", Toy)
    code, _, err = sweep(RUN + "--members 1500 --out cut --resume")
    assert code == 0
    assert f"cut off {24 * size + 100} bytes" in err
    assert file.read_bytes() == whole


def test_going_on_with_other_code_is_noticed(sweep, tmp_path, monkeypatch):
    class Changed(Toy):
        def run(self, members):
            return super().run(members) * 1.5

    assert sweep(RUN + "--members 1500 --out a")[0] == 0
    whole = (tmp_path / "a/rows.bin").read_bytes()
    half = whole[: len(whole) // 2]
    for engine, noticed in ((Toy, False), (Changed, True)):
        (tmp_path / "a/rows.bin").write_bytes(half)
        monkeypatch.setattr(tuning.campaign.execute, "Engine", engine)
        code, _, err = sweep(RUN + "--members 1500 --out a --resume")
        assert code == 0
        assert ("comes out differently" in err) == noticed
        assert (tmp_path / "a/rows.bin").read_bytes().startswith(half)


def test_a_finished_campaign_is_not_computed_again(sweep, tmp_path, monkeypatch):
    assert sweep(RUN + "--members 600 --out a")[0] == 0
    monkeypatch.setattr(tuning.campaign.execute, "Engine", None)
    assert sweep(RUN + "--members 600 --out a --resume")[0] == 0


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("--members 600 --out a", ("--out a holds a campaign", "--resume")),
        ("--members 599 --out a --resume", ("of 600 members", "--members 599")),
        ("--members 600 --seed 1 --out a --resume", ("other options (seed)",)),
        ("--members 600 --shard 1/2 --out a --resume", ("other options (shard)",)),
        ("--members 600 --uncertainty 0.3 --out a --resume", ("(uncertainty)",)),
        ("--members 0", ("--members", "at least 1")),
        ("--shard 3/2", ("--shard", "1 <= I <= N", "'3/2'")),
        ("--gains gone.toml", ("gone.toml", "no such file")),
        ("--gains u.toml", ("u.toml", "controller.type is missing")),
        ("--uncertainty gone.toml", ("gone.toml", "cannot be read")),
        ("--uncertainty u.toml", ("--uncertainty", "vehicle")),
        ("--uncertainty 0", ("--uncertainty must be above zero",)),
        ("--uncertainty 1", ("--uncertainty", "[0, 1)")),
        ("--hosts 2 --shard 1/2", ("--coordinator ADDRESS:PORT", "go together")),
        ("--coordinator here:1", ("--coordinator", "received here:1, 1 and 0")),
        ("--until-ci 0.1 --shard 1/2", ("--until-ci does not go with --shard",)),
        ("--require p_violation", ("--require", "p_violation<0.01")),
        ("--require p_violation<nan", ("a finite number", "'p_violation<nan'")),
        ("--require p_violation<-inf", ("a finite number", "'p_violation<-inf'")),
        ("--require max_roll.q95<inf", ("a finite number", "'max_roll.q95<inf'")),
        ("--require p_violation<", ("--require", "received 'p_violation<'")),
        ("--require <0.1", ("--require", "received '<0.1'")),
        ("--require p_violation<0.1<0.2", ("--require", "a finite number")),
        ("--require smc:p_capsize<=1.5", ("in [0, 1]", "'smc:p_capsize<=1.5'")),
        ("--require p_failure>-0.1", ("in [0, 1]", "'p_failure>-0.1'")),
        ("--require p_flood<1", ("--require", "'p_flood' is no quantity")),
        ("--require ppc:p_capsize<1", ("no gains are called 'ppc'", "smc")),
        ("--require roll.speed.q95<1", ("no measure 'roll.speed'", "max_roll")),
    ],
)
def test_what_cannot_be_run_is_refused(sweep, kept, tmp_path, text, parts):
    (tmp_path / "u.toml").write_text("[[vehicles]]\nnames = 'all'\n")
    kept("a", "--members 600")
    before = (tmp_path / "a/rows.bin").read_bytes()
    code, out, err = sweep(RUN + text)
    assert (code, out) == (2, "")
    for part in parts:
        assert part in err.splitlines()[-1]
    assert (tmp_path / "a/rows.bin").read_bytes() == before


@pytest.mark.parametrize("design", ["monte-carlo", "sobol"])
def test_a_campaign_grows_by_more_members(sweep, tmp_path, design):
    told = f"{RUN} --design {design}"
    assert sweep(f"{told} --members 1500 --out whole")[0] == 0
    whole = (tmp_path / "whole/rows.bin").read_bytes()
    assert sweep(f"{told} --members 600 --out a")[0] == 0
    size = read_manifest(tmp_path / "a").row_type().itemsize
    assert (tmp_path / "a/rows.bin").read_bytes() == whole[: 600 * size]
    assert sweep(f"{told} --members 1500 --out a --resume")[0] == 0
    assert (tmp_path / "a/rows.bin").read_bytes() == whole
    grown, once = (
        json.loads((tmp_path / name / "summary.json").read_text())
        for name in ("a", "whole")
    )
    del grown["provenance"], once["provenance"]
    assert grown == once
    manifest = read_manifest(tmp_path / "a")
    assert (manifest.settings.members, manifest.last) == (1500, 1500)


def test_a_merged_campaign_grows_and_a_part_or_latin_hypercube_does_not(
    sweep, tmp_path
):
    for i in (1, 2):
        assert sweep(f"{RUN} --members 600 --out s{i} --shard {i}/2")[0] == 0
    for i in (1, 2):
        more = f"{RUN} --members 900 --out s{i} --shard {i}/2 --resume"
        code, _, err = sweep(more)
        assert code == 2
        assert f"s{i} holds a part of a campaign of 600 members" in err
    assert sweep("merge s1 s2 --out all --no-report")[0] == 0
    assert sweep(f"{RUN} --members 900 --out all --resume")[0] == 0
    assert sweep(f"{RUN} --members 900 --out whole")[0] == 0
    grown, whole = (tmp_path / name / "rows.bin" for name in ("all", "whole"))
    assert grown.read_bytes() == whole.read_bytes()
    latin = f"{RUN} --design latin-hypercube --out latin --members"
    assert sweep(f"{latin} 20")[0] == 0
    before = (tmp_path / "latin/rows.bin").read_bytes()
    code, _, err = sweep(f"{latin} 30 --resume")
    assert code == 2
    assert "by how many there are, so that one of 20 cannot grow to 30" in err
    assert (tmp_path / "latin/rows.bin").read_bytes() == before


def test_equal_files_are_equal_however_they_are_named(sweep, tmp_path):
    def write(folder, head="", k=0.3):
        (tmp_path / folder).mkdir(exist_ok=True)
        law = f'[controller]\ntype = "smc"\n[controller.c0]\npitch = {k}\n'
        width = 'law = "uniform"\nhalf_width = 0.1\n'
        for name, text in (("g", law), ("u", f"[[vehicle]]\n{width}")):
            (tmp_path / folder / f"{name}.toml").write_text(head + text, "utf-8-sig")

    def told(folder):
        files = f"--gains {folder}/g.toml --uncertainty {folder}/u.toml"
        return f"{RUN} --members 20 {files}".replace("--controller smc", "")

    write("a")
    write("b", "# A comment.\n\n")
    assert sweep(told("a") + " --out o")[0] == 0
    for folder in ("./a", tmp_path / "a", "b", "a/../b"):
        code, _, err = sweep(told(folder) + " --out o --resume")
        assert code == 0, err
    for i, folder in enumerate(("a", "./b"), 1):
        assert sweep(told(folder) + f" --out s{i} --shard {i}/2")[0] == 0
    assert sweep("merge s1 s2 --out whole --no-report")[0] == 0
    rows = [(tmp_path / name / "rows.bin").read_bytes() for name in ("o", "whole")]
    assert rows[0] == rows[1]
    write("c", k=0.4)
    code, _, err = sweep(told("c") + " --out o --resume")
    assert code == 2
    assert "other options (gains)" in err


def test_requirements_are_met_by_whole_intervals(sweep, tmp_path):
    base = RUN + "--members 600 --out a "
    code, out, _ = sweep(base + "--require p_violation<0.5 smc:p_failure<0.2")
    assert code == 0
    assert out.count(": met by smc") == 2
    # The estimate is about 0.25: the interval reaches beyond 0.26.
    estimate = json.loads((tmp_path / "a/summary.json").read_text())
    found = estimate["controllers"]["smc"]["probabilities"]["p_violation"]
    between = (found["p"] + found["interval"][1]) / 2
    code, out, _ = sweep(base + f"--resume --require p_violation<{between}")
    assert code == 3
    assert "not shown by smc" in out
    code, out, _ = sweep(base + "--resume --require p_violation<0.1")
    assert code == 3
    assert "violated by smc" in out
    code, _, _ = sweep(base + "--resume --require p_violation>0.1")
    assert code == 0


def test_a_campaign_stops_when_it_knows_enough(sweep, tmp_path):
    base = RUN + "--members 100000 --until-ci 0.06 --out a"
    code, out, _ = sweep(base + " --json")
    summary = json.loads(out)
    low, high = summary["controllers"]["smc"]["probabilities"]["p_violation"][
        "interval"
    ]
    assert code == 0
    assert high - low <= 0.06
    # 4 · 1.96² · p(1 − p)/0.06² for p near 1/4.
    assert summary["members"] in (STEP, 2 * STEP)
    rows = (tmp_path / "a/rows.bin").read_bytes()
    assert sweep(base + " --resume")[0] == 0
    assert (tmp_path / "a/rows.bin").read_bytes() == rows


def test_several_levels_and_gains_meet_the_same_members(sweep, tmp_path):
    code, out, _ = sweep(
        "sweep --precision 64 --plant printed --duration 2 --controller smc ppc "
        "--no-report "
        "--members 520 --uncertainty 0.1 0.3 --out a --json"
    )
    assert code == 0
    levels = json.loads(out)["levels"]
    assert [level["uncertainty"] for level in levels] == [0.1, 0.3]
    pair = levels[0]["paired"][0]
    failed = levels[0]["controllers"]["smc"]["failed_members"]
    error = pair["measures"]["pitch.rms_error"]
    assert (pair["first"], pair["second"]) == ("smc", "ppc")
    assert error["difference"] == pytest.approx(-0.25)
    assert error["wins"] == 520 - len(failed)
    assert error["ties"] == len(failed)
    assert pair["violation"]["p_value"] == 1.0
    draws = []
    for level in (0.1, 0.3):
        folder = tmp_path / f"a/uncertainty-{level}"
        rows = read_rows(folder / "rows.bin", read_manifest(folder).row_type())
        nominal = build(dataclasses.replace(SETTINGS)).uncertainty.scenario
        mass = float(nominal.plant.parameters.surge_mass)
        names = [q[0] for q in read_manifest(folder).quantities]
        draws.append(
            (rows["values"][:, names.index("surge_mass")] / mass - 1.0) / level
        )
    np.testing.assert_allclose(*draws, atol=1e-9)


def test_the_report_answers_in_tables_and_figures(sweep, tmp_path, monkeypatch):
    # The ribbons' own rollouts are tested below.
    seen = Ribbons(
        np.arange(4.0),
        {c: np.zeros((3, 4)) for c in CHANNELS},
        {c: (-np.ones(4), np.ones(4)) for c in CHANNELS},
        {c: np.array([0.0, 1.0, np.nan, np.nan]) for c in CHANNELS},
    )
    monkeypatch.setattr(tuning.campaign.report.report, "ribbons", lambda *a: seen)
    code, out, _ = sweep(
        "sweep --precision 64 --plant printed --duration 2 --controller smc ppc "
        "--members 60 --uncertainty 0.1 0.3 --out a --require p_failure<1 --json"
    )
    assert code == 0
    found = json.loads(out)["levels"][0]["controllers"]["smc"]["probabilities"]
    k, n = found["p_violation"]["k"], found["p_violation"]["n"]
    low, high = found["p_violation"]["interval"]
    for folder, parts in (
        ("a", ("[uncertainty-0.1]", "![levels]", "## What drives it")),
        ("a/uncertainty-0.1", ("## ppc against smc", "`p_failure<1` | smc | met")),
    ):
        text = (tmp_path / folder / "report.md").read_text()
        assert f"{k / n:.4g} [{low:.4g}, {high:.4g}]" in text
        for part in parts:
            assert part in text
        for name in re.findall(r"\]\(([^)]*)\)", text):
            assert (tmp_path / folder / name).stat().st_size > 100
        page = mailable(tmp_path / folder / "report.html")
        assert len(page.loads) == text.count("![")


def test_ribbons_are_the_errors_of_the_members_and_of_the_worst(campaign, alone):
    seen = ribbons(campaign, 0, 3, 7)
    assert {x.shape for x in seen.errors.values()} == {(3, 40)}
    for number, found in ((2, seen.errors["pitch"][2]), (7, seen.worst["pitch"])):
        run = alone(number)
        np.testing.assert_allclose(found, run.ticks.error.pitch, rtol=1e-9, atol=1e-15)
        lower, upper = seen.edges["pitch"]
        np.testing.assert_allclose(upper, run.ticks.limits.pitch.upper, rtol=1e-12)
        np.testing.assert_allclose(lower, run.ticks.limits.pitch.lower, rtol=1e-12)


def test_rank_correlations_find_what_drives_a_known_result():
    rng = np.random.default_rng(0)
    x = rng.random((400, 4))
    x[:, 3] = 1.0
    result = np.exp(3.0 * x[:, 1]) - 0.5 * x[:, 0]
    result[result.argmax()] = np.inf
    found = rank_correlations(x, result)
    expected = [stats.spearmanr(x[:, j], result).statistic for j in range(3)]
    np.testing.assert_allclose(found["rho"], [*expected, 0.0], atol=1e-12)
    assert found["rho"][1] > 0.95
    assert found["low"][2] < 0.0 < found["high"][2]


def test_rows_that_cannot_be_written_leave_those_before_safe(tmp_path):
    rows = make_rows(0, np.ones((4, 2)), np.ones((4, 1, len(COLUMNS))))
    store = Store(tmp_path / "rows.bin", rows.dtype, 0)
    store.append(rows[:2])
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    limit = int(2.5 * rows.dtype.itemsize)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, old[1]))
        with pytest.raises(StoreFull, match=r"2 members are safe. Make room"):
            store.append(rows[2:])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert (tmp_path / "rows.bin").read_bytes() == rows[:2].tobytes()
    store.append(rows[2:])
    assert store.rows().tobytes() == rows.tobytes()
    with pytest.raises(ValueError, match="another process"):
        Store(tmp_path / "rows.bin", rows.dtype, 0)
    store.close()


def test_a_full_disk_ends_a_campaign_with_code_1(sweep, tmp_path, monkeypatch):
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, old[1]))
        code, _, err = sweep(RUN + "--members 1500 --out a")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert code == 1
    assert "512 members are safe. Make room and go on with --resume" in err

    def full(*arguments):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(tuning.campaign.report.conclude, "write_members", full)
        code, _, err = sweep(RUN + "--members 1500 --out a --resume")
    assert code == 1
    assert "no space left on device); 1500 members are safe. Make room" in err
    assert sweep(RUN + "--members 1500 --out a --resume")[0] == 0
    assert sweep(RUN + "--members 1500 --out b")[0] == 0
    rows = [(tmp_path / f"{name}/rows.bin").read_bytes() for name in "ab"]
    assert rows[0] == rows[1]


def test_a_column_of_a_failed_run_is_infinite():
    metrics = np.ones((3, 1, len(COLUMNS)))
    metrics[1, 0, COLUMNS.index("finite")] = 0.0
    metrics[2, 0, COLUMNS.index("depth.rms_error")] = np.nan
    table = Rows(make_rows(0, np.ones((3, 1)), metrics), ("x",))
    np.testing.assert_array_equal(
        table.column(0, "depth.rms_error"), [1.0, np.inf, np.inf]
    )


def test_a_run_that_ended_before_its_funnel_settled_has_no_error_after_it():
    metrics = np.ones((3, 1, len(COLUMNS)))
    metrics[1, 0, COLUMNS.index("finite")] = 0.0
    metrics[1:, 0, COLUMNS.index("depth.max_error_settled")] = np.nan
    table = Rows(make_rows(0, np.ones((3, 1)), metrics), ("x",))
    np.testing.assert_array_equal(
        table.column(0, "depth.max_error_settled"), [1.0, np.inf, np.nan]
    )
