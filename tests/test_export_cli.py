"""Exports and software in the loop from the command line."""

import json
import shutil
import subprocess
import sys
import tomllib

import compiled_c
import numpy as np
import pytest

import tuning.cli.main
import tuning.evaluation.runs
from jaxglider import paper
from jaxglider.files.codec import encode
from jaxglider.files.gains import load_gains
from jaxglider.onboard.pipe import ChildProcess, PipeError
from tuning.cli.main import main

MISSION = """
name = "bay"
[clock]
duration_s = 12.0
[reference]
type = "waypoints"
[reference.waypoints]
north_m = [4.0, 9.0]
east_m = [1.0, -3.0]
radius_m = 4.5
abeam_m = 9.0
[controller]
type = "smc"
[[disturbance]]
type = "paper"
"""

needs_make = pytest.mark.skipif(
    compiled_c.COMPILER is None or shutil.which("make") is None,
    reason="no make or no C compiler on this machine",
)


@pytest.fixture(autouse=True)
def at_home(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tuning.cli.main, "start_jax", lambda precision: None)
    monkeypatch.setattr(tuning.evaluation.runs, "save_all", lambda *args: [])
    (tmp_path / "mission.toml").write_text(MISSION)


@pytest.mark.parametrize("kind", ["toml", "json"])
def test_gains_come_back_from_either_format(call, tmp_path, kind):
    code, out, _ = call(
        *("export", "--gains", "paper", "--controller", "ppc"),
        *("--scenario", "waypoints", "--format", kind, "--out", "there"),
    )
    assert code == 0
    assert "1 files in there" in out
    text = (tmp_path / "there" / f"gains.{kind}").read_text()
    table = tomllib.loads(text) if kind == "toml" else json.loads(text)
    model = paper.design_model(paper.make_scenario("waypoints").plant)
    given = paper.make_controller("ppc", "waypoints", model)
    assert table["controller"] == encode(given)
    assert table["provenance"]["scenario"] == "waypoints"
    if kind == "toml":
        law = load_gains(tmp_path / "there" / "gains.toml", "switching", model)
        assert law.kind == "ppc"
        assert encode(law.controller) == encode(given)


def test_stablehlo_has_an_argument_for_every_scalar(call, tmp_path):
    code, *_ = call(
        *("export", "--gains", "paper", "--controller", "smc"),
        *("--format", "stablehlo", "--out", "there"),
    )
    assert code == 0
    about = json.loads((tmp_path / "there" / "arguments.json").read_text())
    for name in ("init", "plan", "step"):
        text = (tmp_path / "there" / f"glider_{name}.mlir").read_text()
        head = next(line for line in text.splitlines() if "@main(" in line)
        given, _, returned = head.partition("->")
        assert given.count("tensor<") == len(about[name]["arguments"])
        assert returned.count("tensor<") == len(about[name]["results"])
        assert "stablehlo." in text


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--gains", "nowhere.toml"], ["nowhere.toml", "no such file"]),
        ([], ["--gains", "--config", "required", "neither"]),
        (["--gains", "paper", "mission.toml"], ["--gains", "required", "both"]),
        (["--config", "mission.toml", "--plant", "printed"], ["--plant", "Leave the"]),
        (
            ["--gains", "paper", "--safe", "1", "0", "0"],
            ["--safe", "0.4", "received 1"],
        ),
        (["--gains", "paper", "--patience", "0"], ["--patience", "positive"]),
        (["--gains", "paper", "--format", "rust"], ["--format", "rust"]),
    ],
)
def test_bad_requests_get_one_line_and_code_2(call, arguments, parts):
    code, out, err = call("export", *arguments)
    assert code == 2
    assert out == ""
    for part in parts:
        assert part in err.splitlines()[-1]


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The controller of the mission as a program."""
    folder = tmp_path_factory.mktemp("exported")
    (folder / "mission.toml").write_text(MISSION)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tuning.cli.main, "start_jax", lambda precision: None)
        given = ["export", "--config", str(folder / "mission.toml"), "--json"]
        assert main([*given, "--out", str(folder / "code")]) == 0
    done = subprocess.run(["make"], cwd=folder / "code", capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("pass") == 5
    return folder / "code" / "controller"


@needs_make
def test_the_exported_readme_says_what_it_costs(program):
    text = (program.parent / "README.md").read_text()
    sizes = subprocess.run(
        ["make", "-s", "time"], cwd=program.parent, capture_output=True, text=True
    ).stdout
    for kind, column in (("float", 1), ("double", 2)):
        line = next(x for x in sizes.splitlines() if x.startswith(kind))
        row = next(x for x in text.splitlines() if x.startswith("| state [bytes]"))
        assert f"state {row.split('|')[column + 1].strip()} bytes" in line
    assert "GLIDER_CLOCK_STUCK" in text


@needs_make
def test_a_program_steers_as_the_mission_itself_does(call, tmp_path, program):
    common = ("simulate", "--config", "mission.toml", "--json")
    code, own, _ = call(*common, "--out", "own")
    assert code == 0
    code, outside, err = call(
        *common, "--controller-binary", program, "--out", "outside"
    )
    assert code == 0, err
    (own,), (outside,) = (json.loads(text)["runs"] for text in (own, outside))
    assert own["waypoints_reached"] == outside["waypoints_reached"] > 0
    for channel, measures in own["channels"].items():
        for name, value in measures.items():
            if "saturat" in name:
                # A program that keeps the limits never asks for more.
                assert outside["channels"][channel][name] == 0.0
                continue
            other = outside["channels"][channel][name]
            assert other == (
                value if value is None else pytest.approx(value, rel=1e-9, abs=1e-12)
            ), (channel, name)
    assert "saturated" in err
    assert (tmp_path / "outside" / "trajectories.nc").exists()


def _script(path, body):
    path.write_text(f"#!{sys.executable}\nimport sys, time\n{body}\n")
    path.chmod(0o755)
    return path


FAKES = {
    "deaf": ("time.sleep(30)", "did not answer within 0.5 s"),
    "dead": ("sys.exit('no battery')", "exit code 1. Its last words: no battery"),
    "odd": ("input(); print('hello', flush=True)", "answered 'hello'"),
}


@pytest.mark.parametrize("fake", FAKES)
def test_a_program_that_does_not_shake_hands_is_refused(call, tmp_path, fake):
    body, said = FAKES[fake]
    code, out, err = call(
        *("simulate", "--config", "mission.toml", "--controller-timeout", "0.5"),
        *("--controller-binary", _script(tmp_path / fake, body)),
    )
    assert code == 2
    assert out == ""
    assert said in err.splitlines()[-1]


LATER = "input(); print('ready', flush=True)\nfor n, _ in enumerate(sys.stdin):\n"
FAIL_LATER = {
    "dies": ("    if n == 7: sys.exit('flat')", "at tick 7 with exit code 1"),
    "babbles": ("    if n == 7: print('um', flush=True)", "answered 'um' at tick 7"),
    "nan": ("    if n == 7: print('nan 0 0 0', flush=True)", "three finite numbers"),
    "sleeps": (
        "    if n == 7: time.sleep(30)",
        "within 0.5 s at tick 7",
    ),
}


def _failing(folder, fake):
    body, said = FAIL_LATER[fake]
    answer = "\n    print('0.1 0 0 0', flush=True)"
    return _script(folder / fake, LATER + body + answer), said


@pytest.mark.parametrize("fake", FAIL_LATER)
def test_what_a_program_does_wrong_later_is_kept_for_the_end(tmp_path, fake):
    script, said = _failing(tmp_path, fake)
    peer = ChildProcess([str(script)], 0.05, timeout=0.5)
    answers = [peer.command(*np.zeros(13)) for _ in range(10)]
    peer.close()
    np.testing.assert_array_equal(answers[:7], [[0.1, 0.0, 0.0]] * 7)
    assert np.isnan(answers[7:]).all()
    assert said in str(peer.failure)


def test_a_program_that_fails_later_ends_the_run_with_code_1(call, tmp_path):
    script, said = _failing(tmp_path, "dies")
    code, out, err = call(
        *("simulate", "--config", "mission.toml", "--controller-binary", script)
    )
    assert code == 1
    assert out == ""
    assert said in err
    assert "Traceback" not in err


def test_a_missing_program_is_a_usage_error(call):
    code, _, err = call(
        "simulate", "--config", "mission.toml", "--controller-binary", "./gone"
    )
    assert code == 2
    assert "./gone cannot be started: No such file" in err


@needs_make
def test_the_program_refuses_another_tick_and_bad_lines(program):
    with pytest.raises(PipeError, match=r"exported for a tick of 0\.05"):
        ChildProcess([str(program)], 0.1)
    peer = ChildProcess([str(program)], 0.05)
    answer = peer.command(*np.zeros(13))
    assert np.isfinite(answer).all()
    # Missing numbers are answered, not refused.
    assert np.isfinite(peer.command(*np.full(13, np.nan))).all()
    assert peer.failure is None
    assert np.isnan(peer.command(*np.zeros(4))).all()
    assert "expected 13 numbers" in str(peer.failure)
    peer.close()


def test_nothing_of_the_command_line_needs_jax_to_answer_for_help():
    code = "import sys\nfrom tuning.cli.parser import parser\nparser()\n"
    code += "assert not {'jax', 'numpy'} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_an_export_replaces_no_file_that_no_export_wrote(call, tmp_path):
    words = ["export", "--gains", "paper", "--controller", "smc", "--format", "toml"]
    folder = tmp_path / "there"
    folder.mkdir()
    (folder / "gains.toml").write_text("mine")
    code, _, err = call(*words, "--out", "there")
    assert code == 2
    assert "--out there holds files that no export wrote (gains.toml)" in err
    assert "--overwrite" in err
    assert (folder / "gains.toml").read_text() == "mine"
    assert call(*words, "--out", "there", "--overwrite")[0] == 0
    # Now it is a folder of ours; the user adds a file that another format would write.
    assert call(*words, "--out", "there")[0] == 0
    (folder / "gains.json").write_text("{}")
    code, _, err = call(*words[:-1], "json", "--out", "there")
    assert code == 2
    assert "gains.json would be replaced" in err
    (folder / "gains.json").unlink()
    assert call(*words[:-1], "json", "--out", "there")[0] == 0
    assert call(*words, "--out", "there")[0] == 0
    table = tomllib.loads((folder / "gains.toml").read_text())
    assert table["provenance"]["exported"] == ["gains.json", "gains.toml"]


def test_the_working_folder_is_told_by_its_path(call, tmp_path, monkeypatch):
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    code, out, err = call(
        "export", "--gains", "paper", "--format", "toml", "--out", "."
    )
    assert code == 0, err
    assert f"1 files in {tmp_path}/empty.\n" in out
