"""A law of a user's own, in a file outside the packages, through every command."""

import json
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
import tomli_w

import tuning.evaluation.runs
from jaxglider import paper
from jaxglider.control.observer import FixedTimeObserver
from jaxglider.core.toml import ConfigError
from jaxglider.files.codec import encode
from jaxglider.files.gains import encode_law, load_gains
from jaxglider.files.law_paths import is_same_law, seen_from
from jaxglider.files.mission import build_mission, load_mission, self_contained
from jaxglider.files.user_law import first_gains, law_entry
from jaxglider.paper.cases import design_model, make_scenario
from tuning.campaign.run.campaign import build
from tuning.campaign.run.store import read_manifest

OWN = "own.py:Steered"
MISSION = {
    "name": "bay",
    "clock": {"duration_s": 4.0, "dt_s": 0.1},
    "controller": {"type": OWN, "trim_m": -0.02},
}
FUNNEL = (
    '    funnel: Funnel | None = eqx.field(default=None, metadata={"tuned": False})\n'
)
MODEL = design_model(make_scenario().plant)


@pytest.fixture(autouse=True)
def own(tmp_path, monkeypatch):
    """The law's file in an empty folder; drawing is tested elsewhere."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tuning.evaluation.runs, "save_all", lambda *args: [])
    shutil.copy(Path(__file__).with_name("own_law.py"), tmp_path / "own.py")
    return tmp_path / "own.py"


def test_it_is_simulated_in_place_of_a_missions_law(call, own):
    (own.parent / "m.toml").write_text(
        tomli_w.dumps(MISSION | {"controller": {"type": "smc"}})
    )
    code, out, err = call(
        "simulate", "--config", "m.toml", "--controller", OWN, "--json"
    )
    assert code == 0, err
    (run,) = json.loads(out)["runs"]
    assert run["controller"] == "Steered"
    # The same law from a mission file, with its own numbers over those it begins with.
    folder = own.parent / "missions"
    folder.mkdir()
    own.rename(folder / "own.py")
    (folder / "m.toml").write_text(tomli_w.dumps(MISSION))
    code, out, err = call("simulate", "--config", "missions/m.toml", "--json")
    assert code == 0, err
    (other,) = json.loads(out)["runs"]
    assert other["controller"] == "Steered"
    channels = other["channels"]
    assert channels["pitch"]["rms_error"] != run["channels"]["pitch"]["rms_error"]
    mission = load_mission("missions/m.toml")
    assert mission.law.kind == "missions/own.py:Steered"
    assert float(mission.loop.controller.trim) == -0.02
    assert float(mission.loop.controller.lead) == 2.0
    assert type(mission.loop.observer) is FixedTimeObserver


def test_it_is_compared_beside_the_laws_of_the_catalogue(call):
    code, out, err = call(
        *("compare", "--controllers", OWN, "smc", "--scenario", "switching"),
        *("--dt", "0.5", "--json"),
    )
    assert code == 0, err
    runs = json.loads(out)["runs"]
    assert [run["controller"] for run in runs] == ["Steered", "smc"]
    assert runs[0]["channels"]["depth"]["time_outside_funnel"] < 0.1


def test_it_is_tuned_and_its_gains_go_everywhere(call, own, tmp_path):
    # Without an observer everything compiles faster.
    own_mission = MISSION | {"observer": {"type": "none"}}
    (tmp_path / "m.toml").write_text(tomli_w.dumps(own_mission))
    code, out, err = call(
        *("tune", "--controller", OWN, "--config", "m.toml", "--members", "1"),
        *("--steps", "2", "--no-check", "--out", "t", "--json"),
    )
    assert code == 0, err
    result = json.loads(out)
    assert result["controller"] == "Steered"
    assert set(result["gains"]) == {
        f"controller.{name}" for name in ("depth", "pitch", "heading", "lead", "trim")
    }
    # The path is from the file's own folder, so that it loads from any other.
    tables = tomllib.loads((tmp_path / "t" / "gains.toml").read_text())
    assert tables["controller"]["type"] == f"../{OWN}"
    tuned = load_gains("t/gains.toml", "switching", MODEL).controller
    for name, gain in result["gains"].items():
        assert float(getattr(tuned, name.rpartition(".")[2])) == gain["after"]
        assert gain["after"] != gain["before"]

    code, out, err = call(
        *("check-gradients", "--gains", "t/gains.toml", "--config", "m.toml"),
        *("--short", "--json"),
    )
    assert code == 0, err
    assert json.loads(out)["report"]["verdict"]["kind"] == "trust"

    code, out, err = call(
        *("sweep", "--gains", "t/gains.toml", "mission", "--config", "m.toml"),
        *("--members", "2", "--precision", "64", "--no-report", "--out", "s", "--json"),
    )
    assert code == 0, err
    assert set(json.loads(out)["controllers"]) == {
        "Steered (gains)",
        "Steered (mission)",
    }
    # A campaign needs the law's file no more.
    own.unlink()
    settings = read_manifest(Path("s")).settings
    campaign = build(settings)
    assert campaign.kinds == (OWN, OWN)
    tuned, first = (float(loop.controller.lead) for loop in campaign.loops)
    assert first == result["gains"]["controller.lead"]["before"] == 2.0
    assert tuned == result["gains"]["controller.lead"]["after"]


def test_it_is_exported_and_the_c_agrees_with_it(call, tmp_path):
    code, _, err = call(
        *("export", "--gains", "paper", "--controller", OWN, "--plant", "printed"),
        *("--dt", "0.1", "--out", "c"),
    )
    assert code == 0, err
    tables = tomllib.loads((tmp_path / "c" / "gains.toml").read_text())
    assert tables["controller"]["type"] == f"../{OWN}"
    done = subprocess.run(
        ["make", "-C", "c", "check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_mission_that_needs_no_file_flies_the_same_law(own):
    (own.parent / "m.toml").write_text(tomli_w.dumps(MISSION))
    tables = self_contained("m.toml")
    own.unlink()
    law = build_mission(tables).loop.controller
    assert type(law).__name__ == "Steered"
    assert float(law.trim) == -0.02


def test_its_first_instance_is_made_by_initial_where_there_is_one(own):
    own.write_text(
        own.read_text()
        + "    @classmethod\n"
        + "    def initial(cls, model, funnel):\n"
        + "        trim = model.parameters.moving_mass * 1e-3\n"
        + "        return cls(model, funnel, trim=trim)\n"
    )
    law = first_gains(OWN, "switching", MODEL).controller
    assert law.model is MODEL
    assert float(law.trim) == float(MODEL.parameters.moving_mass) * 1e-3


def test_it_is_listed_like_a_law_of_the_catalogue():
    entry = law_entry(OWN)
    assert (entry.label, entry.observer) == ("Steered", "fixed-time")
    assert law_entry(OWN).cls is entry.cls
    controller = first_gains(OWN, "waypoints", MODEL).controller
    wanted = paper.funnel("waypoints").performance.heading.settling_time
    assert float(controller.funnel.performance.heading.settling_time) == float(wanted)


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (None, ("FILE.py:ClassName with an existing file", "own.py:Steered")),
        (
            ("class Steered", "class Other"),
            ("own.py has no ClassName 'Steered'; it has Other",),
        ),
        (
            ("class Steered(AbstractController)", "class Steered"),
            ("AbstractController",),
        ),
        (("import equinox", "import equinoxx"), ("own.py cannot be run", "equinoxx")),
        (
            (
                "depth: float = eqx.field(converter=as_float, default=0.5)",
                "depth: float = eqx.field(kw_only=True)",
            ),
            ("cannot be made", "'depth'", "initial(model, funnel)"),
        ),
        ((FUNNEL, ""), ("cannot be made", "funnel")),
        (("return wanted, state, ", "return wanted, "), ("must return three things",)),
        (("return wanted, state, ", "return wanted, dt, "), ("the next state", "None")),
        (("ControlRecord(error, rate)", "error"), ("the record", "ControlRecord")),
        (("error.heading +", "bounds.roll +"), ("one tick of it cannot be run",)),
        (("0.01,", "0.05,"), ("Steered.trim must be in (-0.03, 0.03)", "0.05")),
    ],
)
def test_what_is_wrong_with_it_is_said_in_one_line(call, own, change, parts):
    if change is None:
        own.unlink()
    else:
        text = own.read_text()
        assert change[0] in text
        own.write_text(text.replace(*change, 1))
    code, out, err = call("compare", "--controllers", OWN)
    assert (code, out) == (2, "")
    for part in parts:
        assert part in err
    assert err.count("\n") == 1


def test_a_word_that_is_no_law_is_refused_with_both_ways_to_name_one(call):
    code, _, err = call("tune", "--controller", "own.py")
    assert code == 2
    assert (
        "slocum, seaglider, seaexplorer, pid, lqr, lqi, mpc, adrc, backstepping, "
        in err
    )
    code, _, err = call("sweep", "--gains", "tuned", "--controller", OWN)
    assert code == 2
    assert "no gains come with jaxglider" in err


def test_a_class_that_no_file_holds_cannot_be_written():
    namespace = {"Base": law_entry(OWN).cls, "__name__": "nowhere"}
    exec("class Lost(Base): pass", namespace)
    lost = namespace["Lost"]()
    with pytest.raises(ConfigError, match="has no name in smc, ppc"):
        encode(lost)


def test_gains_of_it_load_from_any_folder(own, tmp_path, monkeypatch):
    law = first_gains(OWN, "switching", MODEL)
    loop = law.on(make_scenario())
    (tmp_path / "deep" / "t").mkdir(parents=True)
    (tmp_path / "else").mkdir()
    file = tmp_path / "deep" / "t" / "gains.toml"
    file.write_text(tomli_w.dumps(encode_law(loop, file.parent)))
    assert 'type = "../../own.py:Steered"' in file.read_text()
    for folder in ("else", "deep", "deep/t", "."):
        monkeypatch.chdir(tmp_path / folder)
        kind = load_gains(file, "switching", MODEL).kind
        assert Path(kind.rpartition(":")[0]).samefile(own)
        assert is_same_law(kind, f"{own}:Steered")
    # Beside the file first, then in the working folder.
    shutil.copy(own, tmp_path / "else" / "mine.py")
    file.write_text(file.read_text().replace("../../own.py", "mine.py"))
    monkeypatch.chdir(tmp_path / "else")
    assert load_gains(file, "switching", MODEL).kind == "mine.py:Steered"
    shutil.copy(own, file.with_name("mine.py"))
    assert Path(load_gains(file, "switching", MODEL).kind[:-8]).parent == file.parent


def test_a_law_on_no_common_root_is_named_by_its_whole_path(own):
    assert seen_from("/", str(own) + ":Steered") == f"{own.resolve()}:Steered"
    assert seen_from("anywhere", "smc") == "smc"


@pytest.mark.parametrize("command", ["export", "sweep", "tune", "check-gradients"])
def test_gains_whose_law_is_gone_say_both_places_looked_at(call, own, command):
    (own.parent / "tl").mkdir()
    tables = {"controller": {"type": "my_law.py:Leaky"}}
    (own.parent / "tl" / "gains.toml").write_text(tomli_w.dumps(tables))
    code, _, err = call(command, "--gains", "tl/gains.toml")
    assert code == 2
    assert "tl/gains.toml: controller.type is 'my_law.py:Leaky'" in err
    assert f"{own.parent}/tl/my_law.py and {own.parent}/my_law.py. Put" in err


def test_a_key_that_is_nearly_type_is_told_so():
    for key, near in (("typ", "type"), ("gain_file", "gains_file")):
        with pytest.raises(ConfigError, match=f"{key}; did you mean {near}[?]"):
            build_mission({"controller": {key: "smc"}})
    with pytest.raises(ConfigError, match=r"observer\.tipe; did you mean type"):
        build_mission({"observer": {"tipe": "none"}})
    with pytest.raises(ConfigError, match=r"r\.xyz; choose from gains_file, type"):
        build_mission({"controller": {"xyz": 1}})
