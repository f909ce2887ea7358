"""One folder, one process: whatever the command, and however the other one ends."""

import errno
import fcntl
import signal
import subprocess
import sys

import pytest

from tuning.reporting.output_folder import keep_other_results, writing_to

MISSION = 'clock = {duration_s = 1.0}\ncontroller = {type = "smc"}\n'
OTHER = """
import sys
from pathlib import Path
from tuning.reporting.output_folder import writing_to
with writing_to(Path(sys.argv[1])):
    print("writing", flush=True)
    sys.stdin.readline()
"""


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """Another process that writes to a folder, and that folder."""
    folder = tmp_path_factory.mktemp("shared")
    running = subprocess.Popen(
        [sys.executable, "-c", OTHER, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        encoding="utf-8",
    )
    assert running.stdout.readline() == "writing\n"
    yield running, folder
    running.kill()
    running.communicate()


COMMANDS = [
    "compare --scenario switching",
    "simulate --config m.toml",
    "tune",
    "tune --resume",
    "sweep",
    "sweep --overwrite",
    "sweep --resume",
    "merge shard",
    "merge shard --overwrite",
    "rerun campaign",
    "export --gains paper",
    "trim",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_that_writes_is_refused(call, other, tmp_path, command):
    (tmp_path / "m.toml").write_text(MISSION)
    _, folder = other
    before = sorted(path.name for path in folder.iterdir())
    code, out, err = call(*command.split(), "--out", folder)
    assert (code, out) == (2, "")
    assert err == (
        f"jaxglider: {folder} is being written by another process; wait for it, or "
        "give another folder.\n"
    )
    assert sorted(path.name for path in folder.iterdir()) == before


def test_a_folder_of_one_level_is_refused_too(sweep, other):
    _, folder = other
    levels = folder.rename(folder.with_name("uncertainty-0.2")).parent
    code, _, err = sweep(f"sweep --uncertainty 0.1 0.2 --members 4 --out {levels}")
    (levels / "uncertainty-0.2").rename(folder)
    assert code == 2
    assert "uncertainty-0.2 is being written by another process" in err


def test_a_lock_ends_with_the_process_that_was_killed(call, other):
    running, folder = other
    running.send_signal(signal.SIGKILL)
    running.wait()
    arguments = ("--gains", "paper", "--format", "toml", "--out", folder)
    assert call("export", *arguments)[0] == 0
    assert [path.name for path in folder.iterdir()] == ["gains.toml"]


def test_folders_made_for_nothing_are_removed_again(call, tmp_path):
    code, _, _ = call("export", "--gains", "gone.toml", "--out", "new/folder")
    assert code == 2
    assert not (tmp_path / "new").exists()
    (tmp_path / "old").mkdir()
    call("export", "--gains", "gone.toml", "--out", "old")
    assert (tmp_path / "old").is_dir()


def test_blocks_of_one_process_may_be_nested(tmp_path):
    with writing_to(tmp_path / "a"):
        with writing_to(tmp_path / "a" / ".." / "a"):
            (tmp_path / "a" / "text").write_text("x")
        assert (tmp_path / "a" / "text").read_text() == "x"
        with writing_to(tmp_path / "b"):
            pass
    with writing_to(tmp_path / "a"):
        pass


def test_without_locks_there_is_a_note(tmp_path, monkeypatch, capsys):
    def refused(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refused)
    with writing_to(tmp_path):
        assert list(tmp_path.iterdir()) == []
    err = capsys.readouterr().err
    assert "cannot be locked (No locks available)" in err


def test_results_of_another_command_are_kept_unless_told(tmp_path):
    path = tmp_path / "tune.json"
    keep_other_results(path, ["tune"])
    path.write_text('{"provenance": {"command": ["tune", "--steps", "5"]}}')
    keep_other_results(path, ["tune", "--steps", "5"])
    keep_other_results(path, ["tune", "--steps", "5", "--verbose", "--resume"])
    keep_other_results(path, ["tune"], overwrite=True)
    with pytest.raises(ValueError, match="another command, `jaxglider tune --steps 5`"):
        keep_other_results(path, ["tune"])
    path.write_text("no JSON")
    with pytest.raises(ValueError, match="holds the results of another command"):
        keep_other_results(path, ["tune"])


@pytest.mark.parametrize(
    ("command", "file"),
    [
        ("compare", "metrics.json"),
        ("tune", "tune.json"),
        ("worst", "worst.json"),
        ("check-gradients", "gradients.json"),
        ("fit record.csv", "fit.json"),
    ],
)
def test_each_command_keeps_the_results_of_another(call, tmp_path, command, file):
    path = tmp_path / file
    before = '{"provenance": {"command": ["compare", "--seed", "9"]}}'
    path.write_text(before)
    code, _, said = call(*command.split(), "--out", tmp_path)
    assert code == 2
    assert "holds the results of another command, `jaxglider compare --seed 9`" in said
    assert "--overwrite" in said
    assert path.read_text() == before
