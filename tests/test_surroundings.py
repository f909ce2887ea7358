"""What surrounds a command: locale, home folder, terminal, the user's matplotlibrc."""

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib
import pytest

import jaxglider
from jaxglider.plotting.style import look, new_figure

ROOT = Path(jaxglider.__file__).parents[1]
SOURCES = [
    path
    for folder in ("jaxglider", "tuning", "benchmarks", "docs")
    for path in sorted((ROOT / folder).rglob("*.py"))
]
TEXTS = ("read_text", "write_text")
MISSION = """
name = "Bucht Δ"
[clock]
duration_s = 1.0
[controller]
type = "smc"
"""
COMMANDS = """
import json, pathlib, sys
def nowhere(*_): raise RuntimeError("Could not determine home directory.")
pathlib.Path.home = nowhere
import tuning.cli.main
codes = [tuning.cli.main.main(words) for words in json.loads(sys.argv[1])]
print(codes, flush=True)
"""


def without_encoding(text):
    """Lines of a module that read or write text in the encoding of the locale."""
    tree = ast.parse(text)
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    # `partial(path.read_text, encoding=...)` is a call of its first argument.
    told = {id(call.args[0]): call for call in calls if call.args}
    told |= {id(call.func): call for call in calls}
    for node in ast.walk(tree):
        name = ast.unparse(node).rpartition(".")[2]
        call = told.get(id(node))
        words = [] if call is None else [ast.unparse(x) for x in call.args]
        keywords = {} if call is None else {k.arg: k.value for k in call.keywords}
        modes = [*words, *map(ast.unparse, keywords.values())]
        is_text = not any(re.fullmatch(r"'[a-z+]*b[a-z+]*'", mode) for mode in modes)
        by_method = isinstance(node, ast.Attribute) and name in TEXTS
        opens = isinstance(node, ast.Attribute | ast.Name) and name == "open"
        opens = opens and call is not None
        opens = opens and ast.unparse(node) not in ("os.open", "Image.open")
        runs = (
            call is not None
            and node is call.func
            and ast.unparse(keywords.get("text", node)) == "True"
        )
        told_so = "encoding" in keywords or {"'utf-8'", "'utf-8-sig'"} & set(words)
        if (by_method or (opens and is_text) or runs) and not told_so:
            yield node.lineno


def test_every_text_is_read_and_written_in_utf_8_whatever_the_locale():
    assert len(SOURCES) > 150
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in SOURCES
        for line in without_encoding(path.read_text(encoding="utf-8"))
    ]
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "path.read_text()",
        "path.write_text('x')",
        "TEMPLATE = (folder / 'name').read_text",
        "open(path)",
        "open(path, 'w')",
        "path.open()",
        "io.open(path, mode='w')",
        "subprocess.run(words, text=True)",
    ],
)
def test_the_search_for_texts_without_encoding_finds_them(text):
    assert list(without_encoding(text)) == [1]
    assert not list(without_encoding("open(path, 'rb'), open(path, encoding='utf-8')"))


def test_commands_work_without_home_and_in_a_locale_without_greek(tmp_path):
    """ASCII stands for every locale that lacks a letter of the files."""
    (tmp_path / "greek.toml").write_text(MISSION, encoding="utf-8")
    (tmp_path / "matplotlibrc").write_text("text.usetex: True", encoding="utf-8")
    commands = [
        ["init", "new.toml"],
        ["cache"],
        ["vehicles", "--show", "seawing"],
        ["validate", "greek.toml"],
        ["export", "--config", "greek.toml", "--format", "toml", "--out", "export"],
        ["trim", "--out", "trim"],
    ]
    removed = ("XDG_CACHE_HOME", "JAX_COMPILATION_CACHE_DIR")
    surroundings = {k: v for k, v in os.environ.items() if k not in removed}
    surroundings |= {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS, json.dumps(commands)],
        cwd=tmp_path,
        env=surroundings | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "latin-1"},
        capture_output=True,
        encoding="latin-1",
    )
    assert done.returncode == 0, done.stderr
    codes = json.loads(done.stdout.splitlines()[-1])
    assert codes == [0, 0, 0, 0, 0, 0], done.stderr
    assert "there is no cache: neither XDG_CACHE_HOME nor a home" in done.stdout
    assert "no cache of compiled programs: there is no home folder" in done.stderr
    assert "greek.toml is valid: Bucht ?, smc" in done.stdout
    assert (tmp_path / "trim/trim.png").stat().st_size > 10_000
    gains = (tmp_path / "export/gains.toml").read_text(encoding="utf-8")
    assert 'scenario = "Bucht Δ"' in gains


def test_figures_look_the_same_whatever_the_users_matplotlibrc():
    with look():
        plain = dict(matplotlib.rcParams)
    theirs = {"text.usetex": True, "lines.markersize": 40.0, "axes.facecolor": "red"}
    with matplotlib.rc_context(theirs):
        with look():
            assert dict(matplotlib.rcParams) == plain
            figure = new_figure(2.0, 2.0)
            figure.subplots().set_title("α")
        assert matplotlib.rcParams["lines.markersize"] == 40.0
    assert matplotlib.rcParams["text.usetex"] is False


def test_every_figure_that_a_command_writes_is_drawn_in_our_style():
    """A module that makes or saves a figure says `with look()`; benchmarks reset."""
    for path in SOURCES:
        if "examples" in path.parts:  # figures that a reader's own script saves
            continue
        text = path.read_text(encoding="utf-8")
        if "savefig(" in text or " Figure(" in text:
            assert {"look()", "rcdefaults()"} & set(re.findall(r"\w+\(\)", text)), path
