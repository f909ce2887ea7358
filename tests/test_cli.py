"""The command line as a newcomer meets it: results, messages and exit codes."""

import dataclasses
import inspect
import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import jax
import netCDF4
import numpy as np
import pytest
from matplotlib import pyplot
from test_readme import ROOT, blocks

import tuning.api.results
import tuning.cli.commands.compare
import tuning.cli.commands.simulate
import tuning.cli.main
import tuning.cli.options.arguments
import tuning.cli.parser
import tuning.evaluation.runs
from jaxglider import paper
from jaxglider.control.catalogue import BY_NAME
from jaxglider.files.codec import encode
from jaxglider.files.flight.missions import mission_names
from jaxglider.files.gains import load_gains
from jaxglider.files.mission import TEMPLATE, build_mission, load_mission
from jaxglider.files.uncertainty import load_uncertainty
from jaxglider.paper.tuned import tuned_gains
from jaxglider.signals import COMMAND_UNITS
from jaxglider.simulation.rollout import Trajectory
from jaxglider.vehicle.published import load_vehicle
from tuning.cli.main import main
from tuning.cli.parser import parser
from tuning.cli.session.from_options import black_box_settings, descent_settings
from tuning.problem.spec import EnsembleSpec, ProblemSpec
from tuning.search.settings import BlackBoxSettings, DescentSettings
from tuning.space.coordinates import tunable_paths
from tuning.space.space import CONSTRAINTS, HELD_BY_DEFAULT

# As long as the loops of test_metrics: their compiled program serves this one too.
MISSION = """
name = "bay"
[clock]
duration_s = 20.0
[[disturbance]]
type = "paper"
"""
OUTSIDE = MISSION + "[initial_state]\ndepth_m = 3.0\n"
BURST = MISSION + "[initial_state]\nsurge_m_s = 20.0\n"
CHANNELS = {"depth", "pitch", "heading"}
MEASURES = {
    "max_error",
    "max_error_settled",
    "rms_error",
    "rms_effort",
    "chattering",
    "time_outside_funnel",
}


@pytest.fixture(autouse=True)
def at_home(tmp_path, monkeypatch):
    """In an empty folder, JAX as the tests have set it up, and no figures."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tuning.cli.main, "start_jax", lambda *args, **kwargs: None)
    monkeypatch.setattr(tuning.evaluation.runs, "save_all", lambda *args: [])
    (tmp_path / "mission.toml").write_text(MISSION)


def _environment(tmp_path, **more):
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("JAX", "XLA"))}
    quick = {"JAX_PLATFORMS": "cpu", "XLA_FLAGS": "--xla_backend_optimization_level=0"}
    return {**clean, **quick, "XDG_CACHE_HOME": str(tmp_path), **more}


def encoded(*parts):
    return [encode(part) for part in parts]


def _refused(answer, *parts):
    """Exit code 2, one line on standard error, nothing on standard output."""
    code, out, err = answer
    assert code == 2
    assert out == ""
    assert "Traceback" not in err
    line = err.splitlines()[-1]
    for part in parts:
        assert part in line
    return line


def test_names_on_the_command_line_are_those_of_the_package():
    assert tuning.cli.parser.SCENARIOS == paper.SCENARIOS
    assert tuple(paper.PLANTS) == tuning.cli.parser.PLANTS
    assert HELD_BY_DEFAULT == tuning.cli.options.arguments.HELD_BY_DEFAULT
    assert set(CONSTRAINTS) == {
        *tuning.cli.options.arguments.HELD_BY_DEFAULT,
        *tuning.cli.options.arguments.HELD_ON_REQUEST,
    }
    assert tuple(BY_NAME) == tuning.cli.parser.CONTROLLERS
    assert paper.CONTROLLERS == tuning.cli.options.arguments.PAPER_CONTROLLERS


TOLD_OTHERWISE = {"out", "objective", "method", "steps"}
"""Options whose default a function has as None, or as what the word stands for."""


@pytest.mark.parametrize(
    ("words", "function", "renamed"),
    [
        ("tune", tuning.tune, {}),
        ("sweep", tuning.sweep, {}),
        ("worst", tuning.worst, {}),
        ("fit flight.csv", tuning.fit, {"worst": "profile"}),
    ],
)
def test_a_command_and_its_function_have_the_same_defaults(words, function, renamed):
    options = vars(parser().parse_args(words.split()))
    plain = lambda value: tuple(value) if isinstance(value, list) else value
    told, own = {}, {}
    for name, one in inspect.signature(function).parameters.items():
        option = renamed.get(name, name)
        if option in options and one.default is not one.empty:
            told[name], own[name] = plain(options[option]), one.default
    for name in TOLD_OTHERWISE & set(told):
        del told[name], own[name]
    if words == "sweep":
        own["uncertainty"] = (own["uncertainty"],)
    assert len(told) >= 4
    assert told == own


def test_settings_left_to_tune_are_those_of_the_library():
    options = parser().parse_args(["tune"])
    assert descent_settings(options) == DescentSettings()
    assert options.gradient_memory == ProblemSpec.gradient_memory
    options = parser().parse_args(["tune", "--method", "cma"])
    assert black_box_settings(options) == BlackBoxSettings("cma")
    drawn = {x.name: x.default for x in dataclasses.fields(EnsembleSpec)}
    assert (options.members, options.validation, options.test) == (
        drawn["training"],
        drawn["validation"],
        drawn["test"],
    )


def test_help_and_version_import_nothing_heavy(tmp_path):
    code = (
        "import sys\n"
        "from tuning.cli.main import main\n"
        "for arguments in ['--help'], ['tune', '--help'], ['--version']:\n"
        "    try: main(arguments)\n"
        "    except SystemExit as stop: assert stop.code == 0\n"
        "heavy = {'jax', 'numpy', 'matplotlib', 'netCDF4', 'equinox', 'optax', 'scipy'}"
        "\nassert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    for word in ("compare", "simulate", "tune", "init", "validate", "Exit codes", "0."):
        assert word in done.stdout


def test_no_command_shows_the_help_and_is_a_usage_error(call):
    code, out, _ = call()
    assert code == 2
    assert "usage: jaxglider" in out


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ("fly", ("invalid choice: 'fly'", "compare", "simulate")),
        ("compare --controllers lqg", ("--controllers", "'lqg'", "smc", "fxtppc")),
        ("compare --controllers", ("--controllers", "at least one")),
        ("compare --scenario lake", ("--scenario", "'lake'", "switching", "waypoints")),
        ("compare --plant real", ("--plant", "'real'", "rigid-body")),
        ("compare --dt 0", ("--dt", "positive number", "'0'")),
        ("compare --dt -0.1", ("--dt", "positive number", "'-0.1'")),
        ("compare --dt nan", ("--dt", "positive number", "'nan'")),
        ("compare --dt inf", ("--dt", "positive number", "'inf'")),
        ("compare --dt fast", ("--dt", "positive number", "'fast'")),
        ("compare --precision 16", ("--precision", "16", "32", "64")),
        ("compare --dtt 1", ("unrecognized arguments", "--dtt")),
        ("tune --steps 0", ("--steps", "at least 1", "'0'")),
        ("tune --steps -5", ("--steps", "at least 1", "'-5'")),
        ("tune --steps 1.5", ("--steps", "whole number", "'1.5'")),
        ("tune --members 0", ("--members", "at least 1", "'0'")),
        ("tune --duration 0", ("--duration", "positive number", "'0'")),
        ("tune --learning-rate nan", ("--learning-rate", "positive number", "'nan'")),
        ("tune --learning-rate inf", ("--learning-rate", "positive number", "'inf'")),
        ("tune --seed -1", ("--seed", "[0, 2^32)", "'-1'")),
        ("tune --uncertainty 1.5", ("--uncertainty", "[0, 1)", "'1.5'")),
        ("tune --gradient-memory -1", ("--gradient-memory", "'-1'")),
        ("tune --starts 0", ("--starts", "at least 1", "'0'")),
        ("tune --controller lqg", ("--controller", "'lqg'", "smc", "fxtppc")),
        ("simulate", ("required", "--config", "MISSION")),
        ("simulate a.toml --config b.toml", ("b.toml", "a.toml already; name one")),
        ("tune --stepz 2", ("tune: error: unrec", "--stepz; did you mean --steps?")),
        ("simulate slocum-shalow", ("MISSION", "did you mean slocum-shallow?")),
        ("simulate --mission lost", ("must be one of", "slocum-shallow", "'lost'")),
        ("swep", ("invalid choice: 'swep'", "did you mean sweep?")),
        ("compare --plant rigid", ("--plant", "did you mean rigid-body?")),
        ("simulate --config m.toml --seed 4294967296", ("--seed", "'4294967296'")),
        ("validate", ("required", "MISSION")),
    ],
)
def test_wrong_usage_is_refused_with_argument_rule_and_value(call, arguments, parts):
    _refused(call(*arguments.split()), *parts)


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ("simulate --config gone.toml", ("gone.toml", "no such file")),
        ("simulate --config .", (".", "cannot be read")),
        ("validate gone.toml", ("gone.toml", "no such file")),
        ("compare --gains gone.toml", ("gone.toml", "no such file")),
        (
            "compare --gains mission.toml",
            ("mission.toml: this is a mission file, not a gains file", "--config"),
        ),
        ("tune --objective mission.toml", ("a mission file, not an objective file",)),
        ("tune --uncertainty mission.toml", ("not an uncertainty file; name it in",)),
        ("compare --dt 900", ("Clock.dt", "in (0, 800]", "900.0")),
        (
            "simulate --config mission.toml --out mission.toml",
            ("--out must be a folder; received mission.toml", "is a file. Give"),
        ),
        ("simulate --config mission.toml --out mission.toml/x", ("--out", "/x")),
        ("simulate --config mission.toml --out /proc/none", ("--out /proc/none",)),
        ("compare --out /proc/none", ("--out /proc/none", "cannot be written")),
        ("tune --gains gone.toml", ("gone.toml", "no such file")),
        ("tune --cost gone.py:f", ("--cost", "FILE.py:FUNCTION", "gone.py:f")),
        ("tune --optimizer adm", ("optimizer", "as adam", "'adm'")),
        ("tune --optimizer lbfgs", ("optimizer", "a gradient", "'lbfgs'")),
        ("tune --uncertainty gone.toml", ("gone.toml", "no such file")),
        (
            "tune --uncertainty gone.toml --amplitude 0.1",
            ("--amplitude", "--uncertainty", "gone.toml"),
        ),
        ("tune --objective gone.toml", ("gone.toml", "no such file")),
        ("tune --out /proc/none", ("--out /proc/none", "cannot be written")),
        ("init mission.toml", ("mission.toml exists", "--force")),
        ("init /proc/none/m.toml", ("/proc/none/m.toml", "cannot be written")),
        ("init . --force", (".", "cannot be written")),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(call, arguments, parts):
    code, out, err = call(*arguments.split())
    line = _refused((code, out, err), *parts)
    assert line.startswith("jaxglider: ")
    assert "Errno" not in line
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("[clok]\n", ("unknown key clok", "did you mean clock?")),
        ("seed = 1.5\n", ("seed", "whole number", "1.5")),
        ("[clock]\ndt_s = nan\n", ("clock.dt_s", "finite", "nan")),
        ("[clock]\ndt_s = 0.05\nx\n", ("line 3",)),
        ("[clock]\nduration_s = 1e300\n", ("clock: Clock.ticks", "Shorten the run")),
        (
            "[vehicle.parameters]\nheave_mass = -1.0\n",
            ("vehicle.parameters", "heave_mass must be positive", "-1.0"),
        ),
        (
            "[controller.gains.depth]\nrho = 1.5\n",
            ("controller.gains.depth", "rho must be in (0, 1)", "1.5"),
        ),
        (
            "[controller.funnel.performance.depth]\nfinal_bound_m = 0.7\n",
            ("controller.funnel.performance.depth", "0.648054", "0.7", "lower"),
        ),
        (
            '[reference]\ntype = "waypoints"\n[reference.waypoints]\n'
            "north_m = []\neast_m = []\n",
            ("reference.waypoints", "at least 1 waypoint"),
        ),
        (
            '[reference]\ntype = "waypoints"\n[reference.waypoints]\n'
            "north_m = [9.0, 9.0]\neast_m = [1.0, 1.0]\n",
            ("reference.waypoints", "waypoint 2 equals waypoint 1", "remove one"),
        ),
        ('[controller]\ntype = "lqg"\n', ("controller.type", "smc, ppc, fxtppc")),
    ],
)
@pytest.mark.parametrize("command", ["validate", "simulate --config"])
def test_a_wrong_mission_is_refused_before_anything_is_written(
    call, tmp_path, command, text, parts
):
    (tmp_path / "wrong.toml").write_text(text)
    line = _refused(call(*command.split(), "wrong.toml"), "wrong.toml: ", *parts)
    assert line.startswith("jaxglider: ")
    assert sorted(os.listdir(tmp_path)) == ["mission.toml", "wrong.toml"]


def test_debug_raises_what_was_refused_on_either_side_of_the_command():
    for arguments in (
        ["--debug", "validate", "gone.toml"],
        ["validate", "gone.toml", "--debug"],
    ):
        with pytest.raises(ValueError, match="no such file"):
            main(arguments)


def test_init_writes_the_template_and_never_overwrites_unasked(call, tmp_path):
    code, out, err = call("init", "deep/own.toml")
    assert (code, err) == (0, "")
    assert "jaxglider simulate deep/own.toml" in out
    file = tmp_path / "deep" / "own.toml"
    assert file.read_text() == TEMPLATE()
    file.write_text("mine")
    assert call("init", "deep/own.toml")[0] == 2
    assert file.read_text() == "mine"
    assert call("init", "deep/own.toml", "--force")[0] == 0
    assert file.read_text() == TEMPLATE()


def test_the_cache_of_programs_is_shown_and_cleared(call, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    folder = tmp_path / "home" / "jaxglider"
    (folder / "processor" / "programs").mkdir(parents=True)
    (folder / "processor" / "programs" / "one").write_bytes(bytes(3 * 2**20))
    (tmp_path / "home" / "other").write_text("not ours")
    assert call("cache") == (0, f"{folder}: holds 1 files, 3.0 MiB.\n", "")
    assert call("cache", "--clear") == (0, f"{folder}: cleared 1 files, 3.0 MiB.\n", "")
    assert os.listdir(tmp_path / "home") == ["other"]
    assert call("cache") == (0, f"{folder}: holds 0 files, 0.0 MiB.\n", "")


@pytest.mark.parametrize(
    ("words", "plant"),
    [
        (["--vehicle", "slocum"], "rigid-body"),
        (["--vehicle", "slocum-comet"], "seawing"),
        (["--vehicle", "slocum", "--plant", "seawing"], "seawing"),
        (["--vehicle", "seaglider"], "rigid-body"),
    ],
)
def test_init_writes_a_mission_of_another_glider(call, tmp_path, words, plant):
    """Its limits and rates are written out: those it has where nothing is said."""
    path = tmp_path / "glider.toml"
    code, _, err = call("init", path, *words)
    assert (code, err) == (0, "")
    found = load_mission(path)
    vehicle = load_vehicle(words[1])
    assert (found.vehicle, found.plant, found.remarks) == (vehicle.name, plant, ())
    actuators = found.loop.scenario.actuators
    table = {"vehicle": {"data": words[1], "plant": plant}}
    bare = build_mission(table).loop.scenario.actuators
    assert jax.tree.structure(bare) == jax.tree.structure(actuators)
    for written, own in zip(*map(jax.tree.leaves, (actuators, bare)), strict=True):
        assert float(written) == pytest.approx(float(own), rel=1e-9)
    said = tomllib.loads(path.read_text(encoding="utf-8"))["actuators"]
    for name, unit in COMMAND_UNITS.items():
        pumped = name == "buoyancy_mass" and vehicle.pump
        moves = vehicle.rates is not None and not pumped
        assert (f"rate_limit_{unit}_s" in said[name]) == moves


def test_a_glider_beside_a_mission_is_refused_and_told_where_it_is_said(call):
    for command in ("simulate", "tune", "sweep", "compare", "validate"):
        for mission in (["slocum-shallow"], []):
            code, out, err = call(command, *mission, "--vehicle", "slocum")
            assert (code, out) == (2, "")
            assert "`jaxglider init --vehicle NAME` writes a mission" in err
        code, _, err = call(command, "slocum-comet")
        assert code == 2
        assert "a glider: `jaxglider init --vehicle slocum-comet` writes a" in err
    code, _, err = call("init", "--uncertainty", "--vehicle", "slocum")
    assert code == 2
    assert "--vehicle and --plant go with a mission file" in err


@pytest.mark.parametrize("name", ["slocum", "slocum-comet", "seaglider", "rogue"])
def test_init_names_the_missions_that_such_a_glider_flies(call, tmp_path, name):
    code, out, err = call("init", "--vehicle", name, "--force")
    assert code == 0, err
    assert "`jaxglider validate mission.toml` says whether they suit" in out
    words = {word.strip(",") for word in out.split()}
    family = name.partition("-")[0]
    own = {mission for mission in mission_names() if mission.startswith(family)}
    assert words & set(mission_names()) == own


def test_init_writes_what_is_uncertain_too(call, tmp_path):
    code, out, err = call("init", "--uncertainty")
    assert (code, err) == (0, "")
    assert "--uncertainty uncertainty.toml" in out
    scenario = paper.make_scenario("switching", "printed")
    uncertainty = load_uncertainty(tmp_path / "uncertainty.toml", scenario)
    assert "drag" in uncertainty.names()


def test_gains_of_the_package_are_compared_by_the_word(call, monkeypatch):
    """One entry for each law, with the gains of its file for the case and plant."""
    entries = []

    def remember(given, seed):
        entries.extend(given)
        return [], True

    monkeypatch.setattr(tuning.cli.commands.compare, "run_all", remember)
    law = ("--controllers", "fxtppc")
    code, _, _ = call("compare", "--plant", "rigid-body", "--gains", "tuned", *law)
    assert code == 130
    found = {(e.scenario, e.controller): e.loop for e in entries}
    for scenario in paper.SCENARIOS:
        tuned = found[scenario, "fxtppc (tuned)"]
        model = tuned.controller.model
        file = tuned_gains(scenario, "rigid-body", "fxtppc")
        law = load_gains(file, scenario, model)
        wanted = encoded(law.controller, law.observer)
        assert encoded(tuned.controller, tuned.observer) == wanted


def test_all_laws_fly_a_case_or_a_mission_under_one_sea(call, monkeypatch):
    """Every law once; tuned gains for those that have some, the others are named."""
    entries = []

    def remember(given, seed):
        entries[:] = given
        return [], True

    monkeypatch.setattr(tuning.cli.commands.compare, "run_all", remember)
    case = ("--plant", "seawing", "--scenario", "switching", "--gains", "tuned")
    code, _, err = call("compare", *case, "--controllers", "all")
    assert code == 130
    tuned = [f"{name} (tuned)" for name in ("smc", "ppc", "fxtppc", "pid")]
    assert [entry.controller for entry in entries] == [*BY_NAME, *tuned]
    assert "no tuned gains come along for fxtppc-roll, slocum, seaglider" in err
    flown = ("--mission", "slocum-shallow", "--controllers", "slocum", "pid", "lqr")
    code, _, _ = call("compare", *flown)
    assert code == 130
    names = [entry.controller for entry in entries]
    assert names == ["slocum (mission)", "pid", "lqr"]
    assert {entry.scenario for entry in entries} == {"slocum-shallow"}
    kinds = [type(entry.loop.controller) for entry in entries]
    assert kinds == [BY_NAME[name].cls for name in ("slocum", "pid", "lqr")]
    code, _, err = call("compare", *flown, "--gains", "tuned")
    assert code == 130
    names = [entry.controller for entry in entries]
    assert names == ["slocum (mission)", "pid", "lqr", "slocum (tuned)", "pid (tuned)"]
    assert "no tuned gains come along for lqr on slocum-shallow" in err


def test_a_word_is_meant_before_a_file_of_the_name(call, tmp_path, monkeypatch):
    """Which gains are flown does not hang on what lies about in the folder."""
    for word in ("tuned", "paper"):
        (tmp_path / word).write_text("x")
    entries = []
    monkeypatch.setattr(
        tuning.cli.commands.compare,
        "run_all",
        lambda planned, seed: (entries.extend(planned) or [], True),
    )
    code, _, _ = call("compare", "--gains", "tuned", "paper", "--controllers", "smc")
    assert code == 130
    assert {entry.controller for entry in entries} == {"smc", "smc (tuned)"}
    _refused(call("compare", "--gains", "./tuned"), "./tuned: ", "TOML")


def test_a_word_that_is_none_is_no_file_either(call, tmp_path):
    (tmp_path / "mine").write_text("x")
    parts = ("--gains must be paper, tuned, mission or a file", ".toml", "'mine'")
    _refused(call("compare", "--gains", "mine"), *parts)


def test_validate_says_what_would_be_run(call):
    code, out, err = call("validate", "mission.toml")
    assert code == 0
    first, short, unsettled = err.splitlines()
    assert "the paper's (vehicle: SeaWing" in first
    assert "warning: the run ends at 20 s: 3 of 4 segments, from 200 s on" in short
    assert "a segment lasts 20 s, less than errors are given to settle" in unsettled
    assert out == "mission.toml is valid: bay, fxtppc, 400 ticks of 0.05 s.\n"


def test_a_complete_file_is_valid_without_a_word(call, tmp_path):
    (tmp_path / "whole.toml").write_text(TEMPLATE())
    code, out, err = call("validate", "whole.toml")
    assert (code, err) == (0, "")
    assert "whole.toml is valid" in out


def test_a_start_outside_the_funnel_is_a_warning_and_the_run_goes_on(call, tmp_path):
    (tmp_path / "outside.toml").write_text(OUTSIDE)
    code, out, err = call("validate", "outside.toml")
    assert code == 0
    assert "warning: the depth error starts at 3, outside its funnel" in err
    code, out, err = call("simulate", "--config", "outside.toml", "--json")
    assert code == 0
    assert err.count("warning") == 1
    assert "the paper's (vehicle: SeaWing" in err
    assert "warning: the depth error starts at 3, outside its funnel" in err
    assert "the run goes on" in err
    (run,) = json.loads(out)["runs"]
    assert run["channels"]["depth"]["max_error"] >= 3.0
    assert run["channels"]["depth"]["time_outside_funnel"] > 0.5
    assert run["end_time_s"] == pytest.approx(20.0)


def test_metrics_have_the_agreed_keys_and_json_is_the_same_object(call, tmp_path):
    code, out, err = call(
        "simulate", "--config", "mission.toml", "--json", "--out", "o"
    )
    assert code == 0
    result = json.loads(out)
    assert result == json.loads((tmp_path / "o" / "metrics.json").read_text())
    assert set(result) >= {"runs", "provenance"}
    (run,) = result["runs"]
    assert set(run) >= {
        "scenario",
        "plant",
        "controller",
        "end_time_s",
        "finite",
        "channels",
        "max_roll_rad",
        "waypoints_reached",
    }
    assert (run["scenario"], run["controller"]) == ("bay", "fxtppc")
    assert (run["finite"], run["waypoints_reached"]) == (True, None)
    assert set(run["channels"]) == CHANNELS
    for channel in run["channels"].values():
        assert set(channel) >= MEASURES
        # Too short a run for a funnel to settle.
        assert channel.pop("max_error_settled") is None
        assert all(isinstance(value, float) for value in channel.values())
    about = result["provenance"]
    assert (about["seed"], about["precision"], about["partial"]) == (0, 64, False)
    assert set(about["versions"]) >= {"jaxglider", "jax", "python"}
    assert "\njaxglider: o: metrics.json, tables.md, trajectories.nc" in err
    with netCDF4.Dataset(tmp_path / "o" / "trajectories.nc") as file:
        error = file["pitch_error"][0]
        assert list(file["run_name"][:]) == ["bay/printed/fxtppc"]
        assert json.loads(file.provenance) == about
    assert run["channels"]["pitch"]["rms_error"] == pytest.approx(
        np.sqrt(np.mean(error**2)), rel=1e-12
    )
    assert not [name for name in os.listdir(tmp_path / "o") if name.startswith(".")]


def test_the_plot_of_the_docs_is_of_the_depth_that_was_flown():
    """The block of docs/commands.md, of a mission that this file flies anyway."""
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    (block,) = (x for x in blocks(page, "python") if "xarray" in x)
    names = {}
    try:
        exec(block.replace('"slocum-shallow"', '"mission.toml"'), names)
        (line,) = pyplot.gca().lines
        low, high = pyplot.gca().get_ylim()
        label = pyplot.gca().get_ylabel()
    finally:
        pyplot.close("all")
    depth = np.asarray(names["flight"].depth)
    assert len(depth) == 400
    np.testing.assert_array_equal(line.get_ydata(), depth)
    assert low > high
    assert label.endswith("[m]")


def test_the_seed_on_the_command_line_replaces_that_of_the_file(call, tmp_path):
    noise = (
        # The law without an observer compiles fastest.
        'seed = 5\n[clock]\nduration_s = 5.0\n[controller]\ntype = "smc"\n'
        '[[disturbance]]\ntype = "coloured-noise"'
        "\nstandard_deviation_N = 0.5\nstandard_deviation_N_m = 0.1\n"
        "correlation_time_s = 1.0\n"
    )
    (tmp_path / "noise.toml").write_text(noise)
    results = []
    for more in ([], ["--seed", "5"], ["--seed", "6"]):
        code, out, _ = call("simulate", "--config", "noise.toml", "--json", *more)
        assert code == 0
        results.append(json.loads(out))
    own, same, other = (r["runs"][0]["channels"] for r in results)
    assert own == same
    assert own != other
    assert [r["provenance"]["seed"] for r in results] == [5, 5, 6]


def test_a_run_that_becomes_infinite_exits_with_1_and_null(call, tmp_path):
    (tmp_path / "burst.toml").write_text(BURST)
    code, out, err = call("simulate", "--config", "burst.toml", "--json")
    assert code == 1
    told = (
        "bay, fxtppc: failed at 0.05 s: the glider starts at 20 m/s through the water"
    )
    assert told in err
    assert "jaxglider simulate burst.toml --duration 2" in err
    (run,) = json.loads(out, parse_constant=pytest.fail)["runs"]
    assert run["finite"] is False
    assert None in run["channels"]["depth"].values()
    assert run["failure"]["quantity"] == "surge"
    with netCDF4.Dataset(tmp_path / "results" / "simulate" / "trajectories.nc") as file:
        assert file["surge"][0].tolist() == [20.0]
    code, out, err = call("simulate", "--config", "burst.toml")
    assert code == 1
    assert "FAILED at 0.05 s" in out


def test_a_start_that_is_not_finite_is_found_before_the_flight(call, monkeypatch):
    monkeypatch.delattr(tuning.cli.commands.simulate, "run_all")
    (Path() / "lost.toml").write_text(MISSION + "[initial_state]\nsurge_m_s = 1e160\n")
    code, out, err = call("simulate", "lost.toml")
    assert (code, out) == (1, "")
    assert "the run cannot start: the law's command of buoyancy mass is" in err


def test_a_reader_who_has_gone_does_not_cost_the_results(monkeypatch, tmp_path):
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as gone:
        monkeypatch.setattr(sys, "stdout", gone)
        assert main(["simulate", "--config", "mission.toml"]) == 0
        monkeypatch.undo()
    assert (tmp_path / "results" / "simulate" / "metrics.json").exists()


def test_a_failure_while_writing_leaves_the_old_results(call, tmp_path, monkeypatch):
    out = tmp_path / "results" / "simulate"
    assert call("simulate", "--config", "mission.toml")[0] == 0
    before = (out / "trajectories.nc").read_bytes()

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tuning.evaluation.runs, "write_trajectories", full)
    code, _, err = call("simulate", "--config", "mission.toml")
    assert code == 2
    assert "No space left on device" in err
    assert (out / "trajectories.nc").read_bytes() == before


def test_an_interruption_keeps_the_runs_that_are_finished(call, tmp_path, monkeypatch):
    get, calls = tuning.evaluation.runs.jax.device_get, []

    def interrupted(value):
        calls.append(value)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return get(value)

    monkeypatch.setattr(tuning.evaluation.runs.jax, "device_get", interrupted)
    code, out, err = call("compare", "--controllers", "smc", "--json", "--out", "o")
    assert code == 130
    assert "interrupted; keeping 1 finished" in err
    result = json.loads(out)
    assert [run["scenario"] for run in result["runs"]] == ["switching"]
    assert result["provenance"]["partial"] is True
    assert result == json.loads((tmp_path / "o" / "metrics.json").read_text())


def test_an_interruption_before_the_first_run_writes_nothing(
    call, tmp_path, monkeypatch
):
    get = tuning.evaluation.runs.jax.device_get

    def interrupted(value):
        # What looks at the start beforehand goes on.
        if isinstance(value, Trajectory):
            raise KeyboardInterrupt
        return get(value)

    monkeypatch.setattr(tuning.evaluation.runs.jax, "device_get", interrupted)
    code, out, err = call("simulate", "--config", "mission.toml", "--out", "o")
    assert (code, out) == (130, "")
    assert "nothing is written" in err
    assert not (tmp_path / "o").exists()


def test_running_out_of_memory_is_told_in_one_line(call, monkeypatch):
    def full(*args, **kwargs):
        raise RuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 8 bytes.\nx")

    monkeypatch.setattr(tuning.cli.commands.simulate, "run_all", full)
    code, out, err = call("simulate", "--config", "mission.toml")
    assert (code, out) == (1, "")
    taken, told = err.splitlines()
    assert "the paper's (vehicle" in taken
    assert told.startswith("jaxglider: out of memory: shorten the run")


def test_tuned_gains_are_written_and_compared_by_their_folder(
    call, tmp_path, monkeypatch
):
    monkeypatch.setattr(tuning.api.results, "write_tuning_report", lambda *args: None)
    # The law without an observer compiles fastest.
    code, out, err = call(
        *("tune", "--controller", "smc", "--plant", "printed", "--members", "1"),
        *("--steps", "1", "--duration", "5", "--no-check", "--json", "--out", "a"),
    )
    assert code == 0, err
    json.loads(out)
    gains = tomllib.loads((tmp_path / "a" / "gains.toml").read_text())
    assert gains["controller"]["type"] == "smc"
    assert gains["controller"]["c2"]["pitch"] != 5.0
    assert gains["provenance"]["scenario"] == "switching"
    assert (tmp_path / "a" / "history.csv").read_text().count("\n") >= 3
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "gains.toml").write_text(
        '[controller]\ntype = "smc"\n[controller.c1]\npitch = 2.0\n'
    )
    code, out, err = call(
        *("compare", "--scenario", "switching", "--controllers", "smc", "--json"),
        *("--gains", "a/gains.toml", "b/gains.toml", "a/gains.toml", "--out", "o"),
        *("--dt", "0.4"),
    )
    assert code == 0, err
    runs = json.loads(out)["runs"]
    names = ["smc", "smc (a/gains.toml)", "smc (b/gains.toml)"]
    assert [run["controller"] for run in runs] == names
    errors = [run["channels"]["pitch"]["rms_error"] for run in runs]
    assert len(set(errors)) == 3
    with netCDF4.Dataset(tmp_path / "o" / "trajectories.nc") as file:
        assert list(file["run_name"][:]) == [
            f"switching/printed/{name}" for name in names
        ]
        for row, error in enumerate(errors):
            found = np.sqrt(np.mean(file["pitch_error"][row] ** 2))
            assert found == pytest.approx(error, rel=1e-12)
    tables = (tmp_path / "o" / "tables.md").read_text()
    assert "smc paper | smc here | smc (a/gains.toml) here" in tables


def test_python_m_tuning_runs_a_mission_with_all_it_writes(tmp_path):
    quick = MISSION + '[controller]\ntype = "smc"\n'
    (tmp_path / "mission.toml").write_text(quick)
    done = subprocess.run(
        [
            *(sys.executable, "-m", "tuning", "simulate", "--config", "mission.toml"),
            *("--precision", "32", "--json", "--out", "o"),
        ],
        capture_output=True,
        text=True,
        check=False,
        env=_environment(tmp_path / "cache"),
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result == json.loads((tmp_path / "o" / "metrics.json").read_text())
    assert result["provenance"]["precision"] == 32
    assert result["provenance"]["command"][:2] == ["simulate", "--config"]
    with netCDF4.Dataset(tmp_path / "o" / "trajectories.nc") as file:
        assert file["depth"].dtype == np.float32
    figures = os.listdir(tmp_path / "o" / "figures" / "bay")
    assert "tracking.png" in figures
    assert f"{len(figures)} figures" in done.stderr
    assert len(done.stderr.splitlines()) == 2
    assert os.listdir(tmp_path / "cache" / "jaxglider")


def test_ctrl_c_keeps_finished_runs_and_exits_with_130(tmp_path):
    """The progress line of a terminal tells when the second run has begun."""
    screen, terminal = pty.openpty()
    code = (
        "import signal, sys, tuning.cli.main, tuning.evaluation.runs\n"
        # A shell that runs the tests in the background has them ignore the signal.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "tuning.evaluation.runs.save_all = lambda *args: []\n"
        "sys.exit(tuning.cli.main.main())\n"
    )
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", code, "compare", "--scenario", "switching"),
            *("--controllers", "smc", "ppc", "fxtppc", "--out", "o"),
        ],
        stdout=subprocess.PIPE,
        stderr=terminal,
        env=_environment(tmp_path / "cache"),
    )
    os.close(terminal)
    seen, end = "", time.monotonic() + 120.0
    while "2/3" not in seen:
        assert time.monotonic() < end, seen
        seen += os.read(screen, 1000).decode()
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=120)
    seen += os.read(screen, 10000).decode()
    os.close(screen)
    assert process.returncode == 130, seen
    assert "compiling and running" in seen
    assert "interrupted; keeping 1 finished" in seen
    assert "smc: 800.0 s" in out.decode()
    result = json.loads((tmp_path / "o" / "metrics.json").read_text())
    assert [run["controller"] for run in result["runs"]] == ["smc"]
    assert result["provenance"]["partial"] is True


def test_ctrl_c_while_jax_compiles_is_no_crash(tmp_path):
    """What JAX had begun to compile crashed the interpreter as it was torn down."""
    code = (
        "import os, signal, sys, threading, tuning.cli.main, tuning.evaluation.runs\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "run = tuning.evaluation.runs.run_all\n"
        "def interrupted(*a, **k):\n"
        "    stop = os.getpid(), signal.SIGINT\n"
        "    threading.Timer(1.0, os.kill, stop).start()\n"
        "    return run(*a, **k)\n"
        "tuning.evaluation.runs.run_all = interrupted\n"
        "sys.exit(tuning.cli.main.main())\n"
    )
    done = subprocess.run(
        [
            *(sys.executable, "-c", code, "compare", "--scenario", "switching"),
            *("--controllers", "smc", "ppc", "fxtppc", "--out", "o"),
        ],
        capture_output=True,
        text=True,
        check=False,
        env=_environment(tmp_path / "cache"),
    )
    assert done.returncode == 130, done.stderr
    assert done.stderr.startswith("jaxglider: interrupted")


def test_a_wrong_option_costs_two_lines_not_the_whole_usage(call):
    _, _, err = call("tune", "--stepz", "2")
    first, second = err.splitlines()
    assert (
        first == "usage: jaxglider tune [options]; `jaxglider tune --help` lists them"
    )
    assert second.startswith("jaxglider tune: error: ")


@pytest.mark.parametrize(
    "command", ["simulate", "tune", "sweep", "check-gradients", "export"]
)
def test_a_mission_may_be_named_alone(command):
    alone = parser().parse_args([command, "m.toml"])
    named = parser().parse_args([command, "--config", "m.toml"])
    both = parser().parse_args([command, "m.toml", "--config", "m.toml"])
    after = parser().parse_args([command, "--json", "m.toml"])
    assert alone == named == both
    assert after.config == Path("m.toml")
    assert parser().parse_args([command]).config is None


def test_a_path_that_names_nothing_lists_the_groups_there_are(call):
    code, _, err = call("tune", "--free", "nothing")
    assert code == 2
    paths = tunable_paths(
        paper.make_loop("switching", "rigid-body", controller="fxtppc")
    )
    listed = re.search(r"choose from (.*) or a .* \((\d+) in all", err)
    assert int(listed[2]) == len(paths)
    assert all(any(p.startswith(x) for p in paths) for x in listed[1].split(", "))
    assert len(listed[1].split(", ")) <= 10


@pytest.mark.parametrize("command", ["sweep", "export"])
def test_a_law_that_no_gains_ask_for_is_told(call, tmp_path, command):
    (tmp_path / "g.toml").write_text('[controller]\ntype = "ppc"\nnone = 1\n')
    code, _, err = call(command, "--gains", "g.toml", "--controller", "smc")
    assert code == 2
    assert "--controller is not used: it goes with the words paper and tuned" in err
    _, _, err = call(command, "--gains", "g.toml")
    assert "--controller" not in err


def test_what_is_wrong_in_a_call_is_said_before_what_is_odd_in_its_mission(
    call, tmp_path
):
    odd = MISSION + "[water.current]\nnorth_m_s = 20.0\n"
    (tmp_path / "odd.toml").write_text(odd)
    for words in (("tune",), ("check-gradients",)):
        code, out, err = call(*words, "odd.toml", "--free", "haeding")
        assert (code, out) == (2, "")
        lines = [line for line in err.splitlines() if "the paper's (" not in line]
        assert lines[0].startswith("jaxglider: 'haeding' names nothing to tune")
    # Of a call that is right, all commands say what is odd, not validate alone.
    code, out, err = call(*("compare", "odd.toml", "--duration", "0.5", "--json"))
    assert "warning: water.current reaches 20 m/s" in err
