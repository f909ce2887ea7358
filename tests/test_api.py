"""The Python API: a law of one's own is tuned, swept and checked in ten lines."""

import json
import subprocess
import sys
import tomllib

import equinox as eqx
import jax
import numpy as np
import pytest
from html_page import mailable

import tuning
from jaxglider import AbstractController, ControlRecord, DesignModel, paper
from jaxglider.control import Funnel, allocate, tracking_error
from jaxglider.core.containers import as_float
from jaxglider.signals import Channels, Command, map_fields
from jaxglider.simulation.rollout import evaluate
from tuning.problem.aggregates import MEAN, CVaR, SoftWorst
from tuning.problem.arguments import objective_of
from tuning.problem.objective_file import DEFAULT_WEIGHTS

DURATION, DT = 4.0, 0.1


class ProportionalDerivative(AbstractController):
    """U = g⁻¹(η_d'' − k_p e − k_d e' − f − h d̂)."""

    model: DesignModel
    funnel: Funnel
    stiffness: Channels = eqx.field(default=Channels(0.02, 0.05, 0.02))
    damping: Channels = eqx.field(default=Channels(0.2, 0.4, 0.2))

    def init(self):
        return None

    def step(self, state, measurement, reference, bounds, dt):
        error, rate = tracking_error(measurement, reference)
        demand = map_fields(
            lambda a, kp, kd, e, v: a - kp * e - kd * v,
            reference.acceleration,
            map_fields(as_float, self.stiffness),
            map_fields(as_float, self.damping),
            error,
            rate,
        )
        small = map_fields(as_float, Command(1e-4, 1e-4, 1e-4))
        wanted = allocate(self.model, measurement, demand, small)
        return wanted, state, ControlRecord(error, error)


@pytest.fixture(scope="module")
def own():
    loop = paper.make_loop("switching", "printed", "smc", duration=DURATION, dt=DT)
    law = ProportionalDerivative(
        loop.controller.model,
        loop.controller.funnel,
        map_fields(as_float, Channels(0.02, 0.05, 0.02)),
        map_fields(as_float, Channels(0.2, 0.4, 0.2)),
    )
    return eqx.tree_at(lambda at: at.controller, loop, law)


@pytest.fixture(scope="module")
def tuned(own):
    return tuning.tune(
        own,
        free=["controller.stiffness", "controller.damping"],
        **{"members": 2, "validation": 2, "test": 3, "steps": 3},
        check=False,
        progress=False,
    )


def test_a_law_of_ones_own_is_tuned(own, tuned):
    """The objective falls, and the result says of itself what it is."""
    assert set(tuned.gains) == {
        f"controller.{gain}.{channel}"
        for gain in ("stiffness", "damping")
        for channel in ("depth", "pitch", "heading")
    }
    assert [step.number for step in tuned.history] == [0, 1, 2, 3]
    losses = [step.validation for step in tuned.history]
    chosen = int(np.argmin(losses))
    assert losses[chosen] < losses[0]
    before, after = tuned.gains["controller.damping.heading"]
    assert before == pytest.approx(0.2)
    assert after == float(tuned.loop.controller.damping.heading) != before
    assert tuned.verdict.counts["after"].members == 3
    assert "ProportionalDerivative, own" in str(tuned)
    # The verdict's nominal run is the loop that is handed back.
    sea = own.scenario.sea(jax.random.key(0))
    metrics = jax.jit(evaluate)(tuned.loop, sea)
    np.testing.assert_allclose(
        metrics.channels.heading.rms_error,
        tuned.verdict.nominal["after"]["channels"]["heading"]["rms_error"],
        rtol=1e-12,
    )


def test_a_result_is_a_table_and_a_picture(tuned):
    table = tuned.to_xarray()
    assert dict(table.sizes) == {"step": 4, "name": 6}
    np.testing.assert_array_equal(table["loss"], [s.loss for s in tuned.history])
    first = table["gain"].sel(step=0, name="controller.stiffness.pitch")
    assert float(first) == pytest.approx(0.05)
    labels = [axes.get_ylabel() for axes in tuned.plot().axes]
    assert labels == ["objective", "gain over its start"]


def test_gradients_of_a_law_of_ones_own_are_right(own):
    check = tuning.check_gradients(
        own, free=["controller.damping.pitch"], short=True, progress=False
    )
    assert float(check.report.error[0]) < 1e-5
    assert "controller.damping.pitch" in str(check)
    assert check.to_dict()["comparisons"] == []


def test_loops_are_swept_side_by_side(own, tuned, tmp_path):
    result = tuning.sweep(
        {"before": own, "after": tuned.loop},
        members=20,
        out=tmp_path / "a",
        progress=False,
    )
    assert list(result.summary.controllers) == ["before", "after"]
    table = result.to_xarray()
    assert dict(table.sizes) == {"member": 20, "loop": 2}
    # Drawn and run alike again from the rows that are kept.
    again = tuning.sweep(
        {"before": own, "after": tuned.loop},
        members=20,
        out=tmp_path / "a",
        resume=True,
        progress=False,
    )
    assert again.rows.rows.tobytes() == result.rows.rows.tobytes()
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["members"] == 20
    with pytest.raises(ValueError, match="holds a campaign with other options"):
        tuning.sweep(
            {"before": own, "after": own},
            members=20,
            out=tmp_path / "a",
            resume=True,
            progress=False,
        )
    with pytest.raises(ValueError, match="holds a campaign"):
        result.save(tmp_path / "a")


def test_loops_that_fly_different_scenarios_are_refused(own):
    other = eqx.tree_at(lambda at: at.scenario.initial_state.depth, own, 3.0)
    with pytest.raises(ValueError, match="initial_state of 'b' differs from that of"):
        tuning.sweep({"a": own, "b": other}, members=2, progress=False)


def test_what_cannot_be_tuned_is_refused(own):
    with pytest.raises(ValueError, match="names nothing to tune"):
        tuning.tune(own, free="controller.stifness", progress=False)
    with pytest.raises(ValueError, match="members must be a whole number of at"):
        tuning.tune(own, members=0, progress=False)
    with pytest.raises(ValueError, match="resume goes with out"):
        tuning.tune(own, resume=True, progress=False)
    with pytest.raises(ValueError, match="uncertainty must be a number in"):
        tuning.sweep(own, uncertainty=0.0, progress=False)


def test_a_result_is_saved_as_the_command_saves_it(tuned, tmp_path):
    """Its gains file names the class by the file it is in."""
    tuned.save(tmp_path)
    assert len(mailable(tmp_path / "report.html").loads) == 3
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"gains.toml", "history.csv", "tune.json", "report.md"}
    table = tomllib.loads((tmp_path / "gains.toml").read_text(encoding="utf-8"))
    file, _, name = table["controller"]["type"].rpartition(":")
    assert (tmp_path / file).samefile(__file__)
    assert name == "ProportionalDerivative"
    for gain in ("stiffness", "damping"):
        for channel in ("depth", "pitch", "heading"):
            value = float(getattr(getattr(tuned.loop.controller, gain), channel))
            assert table["controller"][gain][channel] == value


def test_the_package_is_light_until_it_is_used():
    code = (
        "import sys, tuning\n"
        "assert 'jax' not in sys.modules\n"
        "assert {'tune', 'sweep', 'check_gradients'} <= set(dir(tuning))\n"
        "from tuning import tune\n"
        "assert 'jax' in sys.modules and callable(tune)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"objective": "x"}, r"objective must be Weights or the path .* received 'x'"),
        ({"objective": 3}, r"objective must be Weights .* received 3"),
        ({"aggregate": "median"}, r"aggregate must be one of mean, cvar, worst"),
        ({"aggregate": 3}, r"aggregate must be mean, cvar, worst or .* received 3"),
        ({"steps": "a"}, r"steps must be a whole number of at least 1; received 'a'"),
        ({"steps": 0}, r"steps must be a whole number of at least 1; received 0"),
        ({"uncertainty": "a"}, r"uncertainty must be a number in \[0, 1\) or an Unc"),
        ({"uncertainty": -0.1}, r"uncertainty must be .* received -0\.1"),
        ({"uncertainty": 1.0}, r"uncertainty must be .* received 1\.0"),
        ({"members": 0}, r"members must be a whole number of at least 1; received 0"),
        ({"members": 2.5}, r"members must be .* received 2\.5"),
        ({"validation": "b"}, r"validation must be .* received 'b'"),
        ({"seed": -1}, r"seed must be a whole number in \[0, 4294967296\)"),
        ({"adversarial": -1}, r"adversarial must be a whole number .* received -1"),
        ({"gradient_memory": -1.0}, r"gradient_memory must be a positive .* -1\.0"),
        ({"gradient_memory": 0}, r"gradient_memory must be a positive .* received 0"),
        ({"settings": 3}, r"settings must be a DescentSettings or None; received 3"),
        ({"method": "cma"}, r"method must be a BlackBoxSettings, as .* 'cma'"),
        ({"cost": "own"}, r"cost must be a function or None; received 'own'"),
        ({"free": [1]}, r"free must be a sequence of texts; received \[1\]"),
        ({"loop": "x"}, r"loop must be a ClosedLoop; received 'x'"),
    ],
)
def test_tune_names_the_argument_the_rule_and_what_was_received(
    own, arguments, message
):
    with pytest.raises(ValueError, match=message):
        tuning.tune(**{"loop": own, "progress": False} | arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"loops": "x"}, r"loops must be a ClosedLoop or .* received 'x'"),
        ({"loops": {"a": 3}}, r"loops\['a'\] must be a ClosedLoop; received 3"),
        ({"members": "many"}, r"members must be a whole number .* 'many'"),
        ({"uncertainty": "a"}, r"uncertainty must be a number in \(0, 1\) .* 'a'"),
        ({"uncertainty": 0.0}, r"uncertainty must be .* received 0\.0"),
        ({"confidence": 1.0}, r"confidence must be a number in \(0, 1\)"),
        ({"until_ci": "a"}, r"until_ci must be .* received 'a'"),
        ({"sensitivity": -1}, r"sensitivity must be .* received -1"),
        ({"seed": "a"}, r"seed must be .* received 'a'"),
    ],
)
def test_sweep_names_the_argument_the_rule_and_what_was_received(
    own, arguments, message
):
    with pytest.raises(ValueError, match=message):
        tuning.sweep(**{"loops": own, "progress": False} | arguments)


def test_a_name_of_a_loop_that_is_no_text_is_refused(own):
    with pytest.raises(
        ValueError, match=r"each name in loops must be text; received 1"
    ):
        tuning.sweep({1: own}, progress=False)


def test_the_words_and_files_of_the_command_line_do_in_python(tmp_path):
    file = tmp_path / "o.toml"
    file.write_text('[weights]\nroll = 2.0\n[aggregate]\nkind = "cvar"\nshare = 0.5\n')
    weights, aggregate = objective_of(str(file))
    assert (weights.roll, aggregate) == (2.0, CVaR(0.5))
    assert objective_of(file, "worst")[1] == SoftWorst()
    assert objective_of(file, CVaR(0.1))[1] == CVaR(0.1)
    assert objective_of(DEFAULT_WEIGHTS) == (DEFAULT_WEIGHTS, MEAN)
    assert objective_of(DEFAULT_WEIGHTS, "cvar")[1] == CVaR()
