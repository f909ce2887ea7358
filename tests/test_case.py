"""Missions of the user's own, tuned and swept like the paper's cases."""

import json
import tomllib
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest
import tomli_w

import tuning.api.results
from jaxglider import paper
from jaxglider.environment.disturbances import Sum
from jaxglider.files.gains import encode_law, load_gains
from jaxglider.files.mission import load_mission
from jaxglider.files.results import metrics_dict
from jaxglider.simulation.rollout import evaluate
from jaxglider.vehicle.published import vehicle_text
from tuning.campaign.run.campaign import build
from tuning.cli.parser import parser
from tuning.cli.session.from_options import (
    campaign_settings,
    flight_case,
    problem_spec,
)
from tuning.problem.case import FlightCase

COURSE = {
    "name": "bay",
    "clock": {"duration_s": 4.0, "dt_s": 0.1},
    "vehicle": {"data": "own.toml", "plant": "rigid-body"},
    "actuators": {"mass_angle": {"rate_limit_rad_s": 0.2}},
    "disturbance": [{"type": "paper"}],
    "reference": {
        "type": "waypoints",
        "waypoints": {"north_m": [1.0], "east_m": [2.0], "radius_m": 0.5},
    },
    "controller": {"type": "smc"},
}


@pytest.fixture(autouse=True)
def bay(tmp_path, monkeypatch):
    """A folder with a mission on a vehicle of its own."""
    monkeypatch.chdir(tmp_path)
    heavier = vehicle_text("seawing").replace("value = 54.28", "value = 50.0", 1)
    assert heavier != vehicle_text("seawing")
    (tmp_path / "own.toml").write_text(heavier)
    (tmp_path / "bay.toml").write_text(tomli_w.dumps(COURSE))


def _options(*words):
    return parser().parse_args([*words, "--config", "bay.toml"])


def test_what_is_tuned_is_the_mission_of_the_file():
    spec = problem_spec(_options("tune", "--members", "1"))
    mission = load_mission("bay.toml")
    assert (spec.case.title, spec.case.kind, spec.controller) == (
        "bay",
        "waypoints",
        "smc",
    )
    assert eqx.tree_equal(spec.loop, mission.loop)
    # Not the law's own funnel, but what the paper's case specifies.
    prescribed = spec.loop.scenario.specification
    assert eqx.tree_equal(prescribed.funnel, paper.funnel("waypoints"))


def test_another_law_can_be_tuned_for_the_same_mission():
    spec = problem_spec(_options("tune", "--members", "1", "--controller", "fxtppc"))
    model = load_mission("bay.toml").loop.controller.model
    wanted = paper.make_controller("fxtppc", "waypoints", model)
    assert spec.controller == "fxtppc"
    assert eqx.tree_equal(spec.loop.controller, wanted)


def test_a_funnel_of_the_mission_is_what_is_judged_by(tmp_path):
    funnel = {"performance": {"heading": {"final_bound_rad": 0.6}}}
    (tmp_path / "bay.toml").write_text(tomli_w.dumps(COURSE | {"funnel": funnel}))
    case = flight_case(_options("tune"))
    assert float(case.specification.funnel.performance.heading.final_bound) == 0.6


def test_the_horizon_alone_can_be_given_beside_a_mission():
    clock = flight_case(_options("tune", "--duration", "2")).scenario.clock
    assert (clock.ticks, float(clock.dt)) == (20, 0.1)


@pytest.mark.parametrize("command", ["tune", "check-gradients", "sweep", "export"])
@pytest.mark.parametrize(
    "words", [("--scenario", "switching"), ("--plant", "printed"), ("--dt", "0.1")]
)
def test_what_the_mission_says_is_not_said_again(call, command, words):
    code, out, err = call(command, "--config", "bay.toml", *words)
    assert (code, out) == (2, "")
    assert f"{words[0]} does not go with a mission: the file bay.toml says" in err


def test_gains_of_a_mission_need_one(call):
    code, _, err = call("sweep", "--gains", "mission")
    assert code == 2
    assert "--gains mission goes with --config FILE." in err


def test_guidance_tuned_for_a_mission_comes_back_with_its_gains(
    call, tmp_path, monkeypatch
):
    monkeypatch.setattr(tuning.api.results, "write_tuning_report", lambda *args: None)
    code, out, err = call(
        *("tune", "--config", "bay.toml", "--members", "1", "--method", "random"),
        *("--free", "scenario.reference.line_of_sight", "controller.c1"),
        *("--population", "4", "--spread", "0.2", "--steps", "3", "--no-check"),
        *("--json", "--out", "a"),
    )
    assert code == 0, err
    result = json.loads(out)
    assert (result["scenario"], result["mission"]) == ("bay", "bay.toml")
    assert set(result["counts"]["after"]) >= {"unfinished", "capsized"}
    written = tomllib.loads((tmp_path / "a" / "gains.toml").read_text())
    path = "scenario.reference.line_of_sight.lookahead"
    after = result["gains"][path]["after"]
    assert written["guidance"]["lookahead_m"] == after != 2.5
    assert written["provenance"]["mission"] == "bay.toml"
    # The mission flown with the file is the run that was tuned.
    table = COURSE | {"controller": {"gains_file": "a/gains.toml"}}
    (tmp_path / "tuned.toml").write_text(tomli_w.dumps(table))
    mission = load_mission("tuned.toml")
    flown = jax.jit(evaluate)(
        mission.loop, mission.loop.scenario.sea(jax.random.key(0))
    )
    flown = metrics_dict(flown, has_waypoints=True)
    for channel, measures in flown["channels"].items():
        np.testing.assert_allclose(
            measures["rms_error"],
            result["nominal"]["after"]["channels"][channel]["rms_error"],
            rtol=1e-12,
        )
    code, _, err = call("export", "--gains", "a/gains.toml")
    assert code == 2
    assert "tuned for the mission bay.toml" in err
    assert "controller.gains_file" in err


def test_going_on_with_another_vehicle_is_refused(tmp_path):
    before = problem_spec(_options("tune")).fingerprint()
    assert before == problem_spec(_options("tune")).fingerprint()
    other = vehicle_text("seawing").replace("value = -389.30", "value = -300.0", 1)
    (tmp_path / "own.toml").write_text(other)
    assert before != problem_spec(_options("tune")).fingerprint()


def test_going_on_with_another_cost_is_refused(tmp_path):
    cost = tmp_path / "mine.py"
    options = _options("tune", "--cost", f"{cost}:f")
    digests = set()
    for text in ("f = max", "f = min", "f = min"):
        cost.write_text(text)
        digests.add(problem_spec(options).fingerprint())
    assert len(digests) == 2


def test_a_campaign_keeps_its_mission_whole(sweep, tmp_path):
    code, out, err = sweep(
        "sweep --no-report --precision 64 --config bay.toml --gains mission paper "
        "--members 20 --out a --json"
    )
    assert code == 0, err
    summary = json.loads(out)
    assert (summary["scenario"], summary["plant"]) == ("bay", "rigid-body")
    assert list(summary["controllers"]) == ["smc (mission)", "fxtppc"]
    assert summary["has_waypoints"] is True
    settings = campaign_settings(
        _options("sweep", "--controller", "smc"), half_width=0.2
    )
    assert [gains.label for gains in settings.gains] == ["smc (mission)"]
    mission = load_mission("bay.toml")
    for name in ("bay.toml", "own.toml"):
        (tmp_path / name).unlink()
    again = type(settings).of(json.loads(json.dumps(settings.__dict__, default=vars)))
    (loop,) = build(again).loops
    assert encode_law(loop) == encode_law(mission.loop)
    assert eqx.tree_equal(loop.scenario.plant, mission.loop.scenario.plant)


MISSIONS = Path(__file__).parents[1] / "benchmarks" / "missions"


@pytest.mark.parametrize(
    ("name", "scenario"), [("course", "waypoints"), ("switching", "switching")]
)
def test_slow_actuators_are_all_that_these_missions_change_of_the_papers(
    name, scenario
):
    loop = load_mission(MISSIONS / f"seawing-{name}.toml").loop
    case = FlightCase.of_paper(scenario, "seawing", None, None)
    gains = MISSIONS / f"seawing-{name}-gains.toml"
    law = load_gains(gains, scenario, loop.controller.model)
    assert (law.guidance is not None) == (scenario == "waypoints")
    wanted = law.on(case.scenario)
    rates = [a.rate_limit for a in vars(loop.scenario.actuators).values()]
    np.testing.assert_allclose(rates, [0.02, 0.005, 0.2])
    # A list of disturbances, with the paper's as its only one.
    assert eqx.tree_equal(loop.scenario.disturbance, Sum((case.scenario.disturbance,)))
    for part in ("plant", "reference", "initial_state", "specification", "clock"):
        assert eqx.tree_equal(
            getattr(loop.scenario, part), getattr(wanted.scenario, part)
        ), part
    assert encode_law(loop) == encode_law(wanted)
