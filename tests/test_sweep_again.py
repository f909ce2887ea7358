"""Shards joined, and members of a campaign run once more."""

import functools
import hashlib
import json

import jax
import netCDF4
import numpy as np
import pytest
import tomli_w
from toy_campaign import RUN

import tuning.campaign.execute
import tuning.cli.commands.rerun
from tuning.campaign.analysis.summary import ranked
from tuning.campaign.run.engine import Engine
from tuning.campaign.run.rows import COLUMNS, Rows, checksums, make_rows
from tuning.campaign.run.store import read_manifest, read_rows


@pytest.fixture
def shards(kept):
    for i in (1, 2, 3):
        kept(f"s{i}", f"--members 1500 --shard {i}/3")


def test_merged_shards_are_the_whole_campaign(sweep, shards, tmp_path):
    assert sweep(RUN + "--members 1500 --out whole --json")[0] == 0
    code, out, _ = sweep("merge s3 s1 s2 --out all --no-report --json")
    assert code == 0
    merged, whole = (tmp_path / name for name in ("all", "whole"))
    assert (merged / "rows.bin").read_bytes() == (whole / "rows.bin").read_bytes()
    first, second = (
        json.loads((f / "summary.json").read_text()) for f in (merged, whole)
    )
    assert json.loads(out) == first
    for summary in (first, second):
        del summary["provenance"]
    assert first == second
    # It is a campaign like any other.
    assert sweep(RUN + "--members 1500 --out all --resume")[0] == 0
    code, out, _ = sweep(
        "merge s1 s2 s3 --out all --no-report --overwrite --require p_violation<0.1"
    )
    assert code == 3


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("s1 s3 --out all", ("members 500 to 999 are missing", "s3")),
        ("s1 s2 --out all", ("members 1000 to 1499 are missing",)),
        ("s1 s2 s3 t --out all", ("members 0 to 499 are there twice",)),
        ("s1 s2 s3 --out s1", ("--out s1 is one of the shards",)),
        ("s1 s2 s3 --out u", ("--out u holds a campaign", "--overwrite")),
        ("s1 u --out all", ("not of the same campaign",)),
        ("s1 gone --out all", ("gone holds no campaign",)),
        ("s1 s2 half --out all", ("half holds 400 of its 500 members", "--resume")),
        ("s1", ("--out",)),
    ],
)
def test_what_cannot_be_merged_is_refused(sweep, kept, shards, tmp_path, text, parts):
    kept("t", "--members 1500")
    kept("u", "--members 20")
    kept("half", "--members 1500 --shard 3/3")
    size = read_manifest(tmp_path / "half").row_type().itemsize
    with open(tmp_path / "half/rows.bin", "r+b") as file:
        file.truncate(400 * size)
    code, out, err = sweep(f"merge --no-report {text}")
    assert (code, out) == (2, "")
    for part in parts:
        assert part in err.splitlines()[-1]


def test_a_member_run_again_is_the_campaigns_own_bit_for_bit(
    sweep,
    tmp_path,
    monkeypatch,
):
    small = functools.partial(Engine, piece=4)
    one = lambda loops, example, devices=None, members=None: small(
        loops, example, jax.local_devices()[:1]
    )
    monkeypatch.setattr(tuning.campaign.execute, "Engine", one)
    monkeypatch.setattr(tuning.cli.commands.rerun, "Engine", one)
    monkeypatch.setattr(tuning.cli.commands.rerun, "save_all", lambda *a: [])
    assert sweep(RUN + "--members 6 --out a")[0] == 0
    summary = json.loads((tmp_path / "a/summary.json").read_text())
    worst = summary["controllers"]["smc"]["worst_member"]
    code, out, err = sweep("rerun a --member worst --json")
    assert code == 0
    again = json.loads(out)
    assert again["member"] == worst
    run = again["runs"][0]
    assert run["row_equal"]
    assert run["trajectory_equal"] == (run["largest_difference"] == 0.0)
    assert run["largest_difference"] < 1e-9
    rows = read_rows(tmp_path / "a/rows.bin", read_manifest(tmp_path / "a").row_type())
    assert again["drawn"]["drag"]["value"] in rows["values"][worst]
    assert again["row"]["smc"]["depth.rms_error"]["value"] > 0.0
    with netCDF4.Dataset(tmp_path / f"a/member-{worst}/trajectories.nc") as file:
        error = file["pitch_error"][0].filled(np.nan)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(
        run["channels"]["pitch"]["rms_error"], rel=1e-12
    )
    # A row that is not this machine's own is noticed.
    data = rows.copy()
    data["metrics"][worst, 0, 0] += 1.0
    data["check"] = checksums(data)
    del rows
    (tmp_path / "a/rows.bin").write_bytes(data.tobytes())
    code, _, err = sweep(f"rerun a --member {worst}")
    assert code == 0
    assert "gives another row than the campaign has" in err


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("rerun a --member 600", ("--member must be in [0, 19]", "received 600")),
        ("rerun a --member best", ("--member", "worst or median", "'best'")),
        ("rerun a --gains ppc", ("--gains must be one of smc", "'ppc'")),
        ("rerun gone", ("gone holds no campaign",)),
        ("rerun b", ("b/campaign.json cannot be used", "changed by hand")),
        ("rerun c", ("c/campaign.json cannot be read",)),
        ("rerun d", ("d holds no members yet",)),
    ],
)
def test_what_cannot_be_run_again_is_refused(sweep, kept, tmp_path, text, parts):
    for name in "abd":
        kept(name, "--members 20")
    manifest = tmp_path / "b/campaign.json"
    manifest.write_text(manifest.read_text().replace('"seed": 0', '"seed": 1'))
    (tmp_path / "c").mkdir()
    (tmp_path / "c/campaign.json").write_text("{")
    (tmp_path / "d/rows.bin").write_bytes(b"")
    code, out, err = sweep(text)
    assert (code, out) == (2, "")
    for part in parts:
        assert part in err.splitlines()[-1]


def test_members_are_ranked_by_their_worst_channel_failures_last():
    metrics = np.ones((5, 1, len(COLUMNS)))
    metrics[:, 0, COLUMNS.index("pitch.funnel_peak")] = [5.0, 3.0, 9.0, 7.0, 8.0]
    metrics[3, 0, COLUMNS.index("finite")] = 0.0
    table = Rows(make_rows(10, np.ones((5, 1)), metrics), ("x",))
    assert ranked(table, 0) == [11, 10, 14, 12, 13]


def test_a_campaign_of_an_older_version_goes_on(sweep, kept, tmp_path):
    """Its sets of gains held the text of a file, as did the digest beside them."""
    kept("old", "--members 512 --no-report")
    path = tmp_path / "old" / "campaign.json"
    campaign = json.loads(path.read_text())
    for entry in campaign["settings"]["gains"]:
        provenance = '[provenance]\nscenario = "switching"\n'
        entry["text"] = tomli_w.dumps(entry.pop("content")) + provenance
    del campaign["settings"]["digest"]
    text = json.dumps(campaign["settings"], sort_keys=True)
    campaign["fingerprint"] = hashlib.sha256(text.encode()).hexdigest()
    path.write_text(json.dumps(campaign))
    rows = (tmp_path / "old" / "rows.bin").read_bytes()
    options = "--members 512 --no-report --out old --resume"
    assert sweep(f"{RUN} {options}")[0] == 0
    assert (tmp_path / "old" / "rows.bin").read_bytes() == rows
    code, _, err = sweep(f"{RUN} {options} --controller ppc")
    assert code == 2
    assert "gains" in err
