"""Every code block of the README runs, and its commands exist."""

import dataclasses
import re
import shlex
from pathlib import Path
from unittest.mock import create_autospec

import equinox as eqx
import jax
import pytest
from test_architecture import ROOMS

import jaxglider
import tuning
from jaxglider import paper
from tuning.cli.parser import parser

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
MOST_LINES = 130


def blocks(text, language):
    """The code blocks of a page."""
    opening = rf"^```(?:{language}| {{ \.{language} }})\n"
    return re.findall(rf"{opening}(.*?)^```", text, re.DOTALL | re.MULTILINE)


def commands(text):
    """What a page calls by `jaxglider ...`, in tables, sentences and shell blocks."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    named = re.findall(r"`jaxglider\s([^`]*)`", prose)
    for block in blocks(text, "sh"):
        lines = block.replace("\\\n", " ").splitlines()
        named += [x.removeprefix("jaxglider ") for x in lines if x.startswith("jax")]
    return [" ".join(words.split()) for words in named]


def assert_parses(text):
    """Refuse a command line that the program would."""
    words = shlex.split(text.partition(" > ")[0])
    try:
        options = parser().parse_args(words)
    except SystemExit:
        pytest.fail(f"a command is named that does not parse: {text}")
    assert options.command == words[0]


def stand_in(kind):
    """What `tune` or `sweep` would give: the attributes of its type and no more."""
    result = create_autospec(kind, instance=True)
    for field in dataclasses.fields(kind):
        setattr(result, field.name, create_autospec(field.type, instance=True))
    return result


@pytest.fixture
def quick(monkeypatch):
    """Long calls answered at once, their arguments checked against the signatures."""
    answers = {
        "tune": "TuneResult",
        "sweep": "SweepResult",
        "check_gradients": "GradientCheck",
    }
    for name, kind in answers.items():
        called = create_autospec(getattr(tuning, name))
        called.return_value = stand_in(getattr(tuning, kind))
        monkeypatch.setattr(tuning, name, called, raising=False)
    # A backend is running already under test: the call would only warn.
    monkeypatch.setattr(jaxglider, "enable_fast_loops", lambda: None)


def run_blocks(texts):
    """Execute blocks one after the other, as a reader would; returns their names."""
    namespace = {"__name__": "page"}
    for text in texts:
        exec(compile(text, "<block>", "exec"), namespace)
    return namespace


def test_python_blocks_run_one_after_the_other(quick, capsys):
    namespace = run_blocks(blocks(README, "python"))
    slope = float(capsys.readouterr().out.split()[0])
    loop = paper.make_loop("switching", "rigid-body", "fxtppc", duration=20.0)
    k2, step = loop.controller.gains.pitch.k2, 1e-6
    error = jax.jit(namespace["pitch_error"])
    above, below = (
        float(error(eqx.tree_at(lambda x: x.controller.gains.pitch.k2, loop, k2 + h)))
        for h in (step, -step)
    )
    assert slope == pytest.approx((above - below) / (2.0 * step), rel=1e-5)
    tuning.tune.assert_called_once()
    tuning.sweep.assert_called_once()


def test_long_calls_of_the_readme_are_checked(quick):
    with pytest.raises(TypeError):
        tuning.tune("loop", step=3)
    with pytest.raises(AttributeError):
        _ = tuning.tune("loop").loops


def test_there_are_exactly_two_set_up_commands_each_complete():
    named = [line for block in blocks(README, "sh") for line in block.splitlines()]
    assert len(named) == 2
    for command in named:
        assert command.startswith("python3 -m venv .venv && ")
        assert "pip install" in command
    assert named[0].endswith("jaxglider tune")
    assert named[1].endswith("pytest")


def test_every_command_named_parses():
    named = commands(README)
    assert len(named) >= 9
    for text in named:
        assert_parses(text)


def test_the_front_page_is_short_and_its_links_lead_somewhere():
    assert len(README.splitlines()) <= MOST_LINES
    for target in re.findall(r"\]\(([^)#:]+)[^)]*\)", README):
        assert (ROOT / target).is_file(), target


def test_the_organization_table_is_the_list_of_rooms():
    rows = re.findall(r"^\| `((?:jaxglider|tuning)/[\w/.]+)` \|", README, re.MULTILINE)
    named = [row.removesuffix(".py").replace("/", ".") for row in rows]
    rooms = [room for room in ROOMS if room not in ("jaxglider", "tuning")]
    tops = list(dict.fromkeys(".".join(room.split(".")[:2]) for room in rooms))
    tops.remove("tuning.__main__")
    assert named == tops
