"""The example scripts run, with settings that take seconds."""

import runpy
import sys

import numpy as np
import pytest
from test_readme import ROOT

import jaxglider

EXAMPLES = ROOT / "docs" / "examples"


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """Runs a script as a shell would; returns its names and what it printed."""
    monkeypatch.setattr(jaxglider, "enable_fast_loops", lambda: None)
    monkeypatch.syspath_prepend(str(EXAMPLES))

    def call(name, *options):
        monkeypatch.setattr(sys, "argv", [name, *map(str, options)])
        names = runpy.run_path(str(EXAMPLES / name))
        return names, capsys.readouterr().out

    return call


def test_simulate_and_look(run, tmp_path):
    names, out = run("simulate_and_look.py", "--duration", 20, "--out", tmp_path)
    error = np.asarray(names["run"].ticks.error.pitch)
    assert f"L2[e] {np.sqrt(np.mean(error**2)):.4f}" in out
    assert (tmp_path / "simulate_and_look.png").read_bytes().startswith(b"\x89PNG")


def test_differentiate(run):
    names, _ = run("differentiate.py", "--duration", 20)
    assert names["slope"] == pytest.approx(names["difference"], rel=1e-4)
    assert abs(names["slope"]) > 1e-3


def test_tune_own_law(run, tmp_path):
    options = "--duration", 10, "--members", 2, "--steps", 2, "--out", tmp_path
    names, out = run("tune_own_law.py", *options)
    result = names["result"]
    assert len(result.gains) == 6
    assert "controller.stiffness.depth" in result.gains
    assert "held-out test, " in out
    moved = [after / before for before, after in result.gains.values()]
    assert result.interrupted is False
    assert all(0.1 < ratio < 10.0 for ratio in moved)
    assert (tmp_path / "gains.toml").is_file()


def test_how_sure(run, tmp_path):
    options = "--duration", 10, "--members", 8, "--out", tmp_path
    names, _ = run("how_sure.py", *options)
    report = names["report"]
    outside = report.summary.controllers["smc"].probabilities["p_violation"]
    rows = report.rows.left_funnel(1)
    assert outside["p"] == rows.mean()
    assert (tmp_path / "how_sure.png").is_file()


def test_on_board(run, tmp_path):
    _, out = run("on_board.py", "--duration", 10, "--out", tmp_path)
    assert "glider_step" in (tmp_path / "glider.h").read_text()
    assert f"make -C {tmp_path}" in out


def test_every_example_is_tested_and_named():
    page = (ROOT / "docs" / "examples.md").read_text()
    tested = {name.removeprefix("test_") for name in globals() if "test_" in name}
    for path in EXAMPLES.glob("*.py"):
        assert f"`docs/examples/{path.name}`" in page
        assert path.stem in tested | {"proportional"}
