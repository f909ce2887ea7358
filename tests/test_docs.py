"""Every page of the documentation: Python runs, commands parse, files are there."""

import re

import pytest
from test_architecture import ROOMS
from test_readme import ROOT, assert_parses, blocks, commands, run_blocks
from test_readme import quick as quick

DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.glob("*.md"))
NOT_RUN = "# not run: "
"""How a block begins that only shows something, before the reason."""


MADE_BY_RECIPES = (
    "compare --plant keel",
    "compare --plant printed --controllers proportional",
    "sea ",
    "tuning/cli/options/sea.py",
)
"""How what a reader of the recipes makes begins; it is not there yet."""


def page_id(path):
    return path.stem


def runnable(text):
    """The blocks to execute."""
    every = blocks(text, "python")
    return [block for block in every if not block.startswith(NOT_RUN)]


RUNNING = [p for p in PAGES if p.stem != "examples" and runnable(p.read_text())]


@pytest.mark.parametrize("path", RUNNING, ids=page_id)
def test_python_blocks_run_one_after_the_other(path, quick, capsys):
    run_blocks(runnable(path.read_text()))


@pytest.mark.parametrize("path", PAGES, ids=page_id)
def test_a_block_that_is_not_run_says_why(path):
    for block in blocks(path.read_text(), "python"):
        if block.startswith(NOT_RUN):
            assert len(block.splitlines()[0]) > len(NOT_RUN) + 10
            compile(re.sub(r"^[\"\w/]+: lambda.*$", "", block, flags=re.M), "x", "exec")


@pytest.mark.parametrize("path", PAGES, ids=page_id)
def test_every_command_named_parses(path):
    for text in commands(path.read_text()):
        if not text.startswith(MADE_BY_RECIPES):
            assert_parses(text)


def test_the_pages_name_every_command():
    from tuning.cli.main import _COMMANDS

    named = {text.split()[0] for text in commands((DOCS / "commands.md").read_text())}
    assert set(_COMMANDS) <= named


@pytest.mark.parametrize("path", PAGES, ids=page_id)
def test_files_that_a_page_names_are_there(path):
    named = r"`((?:docs|tests|benchmarks|jaxglider|tuning)/[\w/.-]+)`"
    for name in re.findall(named, path.read_text()):
        assert (ROOT / name).exists() or name.startswith(MADE_BY_RECIPES), name


def test_every_page_and_room_is_in_the_navigation():
    site = (ROOT / "mkdocs.yml").read_text()
    for path in DOCS.rglob("*.md"):
        assert f" {path.relative_to(DOCS)}\n" in site, path
    rooms = {".".join(room.split(".")[:2]) for room in ROOMS}
    pages = [path.read_text() for path in (DOCS / "reference").rglob("*.md")]
    shown = set(re.findall(r"^::: ([\w.]+)$", "\n".join(pages), re.MULTILINE))
    assert rooms - {"tuning.__main__", "jaxglider", "tuning"} == shown


@pytest.mark.parametrize("package", ["jaxglider", "tuning"])
def test_the_reference_lists_the_public_names(package):
    text = (ROOT / package / "__init__.py").read_text()
    public = set(
        re.findall(r"^ *from ([\w.]+) import (\w+) as \2$", text, re.MULTILINE)
    )
    page = (DOCS / "reference" / "index.md").read_text()
    listed = re.findall(rf"\[`(\w+)`\]\[({package}[\w.]*)\.\1\]", page)
    assert {(name, module) for module, name in public} <= set(listed)
