"""Two things of one name are both kept, or refused before anything runs."""

import json

import netCDF4
import numpy as np
import pytest
from toy_campaign import RUN

from tuning.campaign.report.levels import folder_names
from tuning.campaign.run.store import read_manifest, read_rows
from tuning.cli.options.arguments import uncertainty
from tuning.problem.gain_sets import resolve

SMC = '[controller]\ntype = "smc"\n[controller.c0]\npitch = {}\n'


@pytest.fixture
def files(tmp_path):
    """Uncertainty and gains files of one name in two folders, and their twins."""
    for folder, width in (("a", 0.1), ("b", 0.3)):
        (tmp_path / folder).mkdir()
        law = f'law = "uniform"\nhalf_width = {width}'
        (tmp_path / folder / "u.toml").write_text(f"[[vehicle]]\n{law}\n")
        (tmp_path / folder / "g.toml").write_text(SMC.format(width))
    return tmp_path


def _names(*texts):
    return list(folder_names([uncertainty(text) for text in texts]).values())


def test_levels_have_folders_of_their_own():
    assert _names("0.1", "0.3") == ["uncertainty-0.1", "uncertainty-0.3"]
    assert _names("u.toml", "0.2") == ["u", "uncertainty-0.2"]
    near = _names("0.1", "0.10000001", "0.1000000000000001")
    assert len(set(near)) == 3
    assert _names("a/u.toml", "b/u.toml") == ["a-u", "b-u"]
    assert _names("./u.toml", "../c/u.toml") == ["u", "c-u"]
    assert _names("a/u.toml", "b/U.toml") == ["a-u", "b-U"]
    assert _names("x/report.md.toml", "u.toml") == ["x-report.md", "u"]


@pytest.mark.parametrize(
    "texts",
    [
        ("summary.json.toml", "u.toml"),
        ("a/u.toml", "b/u.toml", "a-u.toml"),
        ("uncertainty-0.1.toml", "0.1"),
        ("u.toml", "../u.toml"),
    ],
)
def test_levels_without_folders_of_their_own_are_refused(texts):
    with pytest.raises(ValueError, match="Rename the file"):
        _names(*texts)


@pytest.mark.parametrize("levels", ["a/u.toml b/u.toml", "0.1 0.10000001"])
def test_both_levels_are_kept(sweep, files, levels):
    code, out, err = sweep(f"{RUN} --members 8 --json --out o --uncertainty {levels}")
    assert code == 0, err
    names = [level["level"] for level in json.loads(out)["levels"]]
    assert len(set(names)) == 2
    drawn = []
    for name in names:
        kind = read_manifest(files / "o" / name).row_type()
        drawn.append(np.array(read_rows(files / "o" / name / "rows.bin", kind)))
    # The same draws, only wider.
    narrow, wide = (np.ptp(rows["values"][:, :5], axis=0) for rows in drawn)
    expected = 3.0 if "toml" in levels else 1.0000001
    np.testing.assert_allclose(wide / narrow, expected, rtol=1e-9)


def test_levels_that_share_a_folder_are_refused_before_any_is_run(sweep, files):
    (files / "uncertainty-0.1.toml").write_text((files / "a/u.toml").read_text())
    command = f"{RUN} --members 8 --out o --uncertainty uncertainty-0.1.toml 0.1"
    code, out, err = sweep(command)
    assert (code, out) == (2, "")
    assert "results would be written to 'uncertainty-0.1'" in err
    assert not (files / "o").exists()


def test_gains_of_one_name_are_told_apart(sweep, files):
    told = "--gains a/g.toml ./b/g.toml"
    command = RUN.replace("--controller smc ", "")
    code, _, err = sweep(f"{command} --members 8 --out o {told}")
    assert code == 0, err
    with netCDF4.Dataset(files / "o/members.nc") as data:
        assert list(data["gains_name"][:]) == ["smc (a/g.toml)", "smc (./b/g.toml)"]


def test_a_file_named_as_a_word_is_told_apart(files, monkeypatch):
    monkeypatch.chdir(files)
    (files / "tuned.toml").write_text(SMC.format(0.5))
    sets = resolve(["tuned", "tuned.toml"], ["smc"], "switching", "printed")
    assert [one.label for one in sets] == ["smc (tuned)", "smc (tuned.toml)"]
    sets = resolve(["a/g.toml", "./a/g.toml", "a/../a/g.toml"], [], "switching", "")
    assert len(sets) == 1


def test_the_papers_gains_are_compared_once(call, files, monkeypatch):
    import tuning.cli.commands.compare as command

    runs = []

    def remember(entries, seed):
        runs.extend(entry.controller for entry in entries)
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "run_all", remember)
    arguments = "compare --scenario switching --controllers smc --gains paper a/g.toml"
    code, _, _ = call(*arguments.split())
    assert code == 130
    assert runs == ["smc", "smc (g)"]
