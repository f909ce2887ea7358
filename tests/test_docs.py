"""Every page of the documentation: Python runs, commands parse, files are there."""

import re

import pytest
from test_architecture import ROOMS
from test_readme import README, ROOT, assert_parses, blocks, commands, run_blocks
from test_readme import quick as quick

from jaxglider.files.results import _STATE
from tuning.campaign.analysis.requirements import PROBABILITIES, STATISTICS
from tuning.campaign.analysis.summary import MEASURES

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


SHOWN = {
    **{path: "examples" for path in (DOCS / "examples").glob("*.py")},
    DOCS / "examples" / "proportional.py": "library",
    **{
        path: "mission"
        for path in (ROOT / "jaxglider" / "files" / "templates").glob("*.toml")
    },
}
"""Files that stand whole in a page: includes are not shown where it is not built."""


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


@pytest.mark.parametrize("path", SHOWN, ids=page_id)
def test_a_file_that_a_page_shows_stands_there_letter_by_letter(path):
    page = DOCS / f"{SHOWN[path]}.md"
    language = {".py": " { .python }", ".toml": "toml"}[path.suffix]
    assert f"```{language}\n{path.read_text()}```\n" in page.read_text(), (
        f"copy {path.relative_to(ROOT)} to {page.relative_to(ROOT)}"
    )


def test_the_architecture_page_has_the_list_of_folders_of_the_readme():
    rows = re.findall(r"^\| `(?:jaxglider|tuning)/.* \|$", README, re.MULTILINE)
    assert len(rows) > 20
    assert "\n".join(rows) in (DOCS / "architecture.md").read_text()


def test_the_library_page_lists_every_field_of_the_state():
    page = (DOCS / "library.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| .+ \| ([\w/]+) \| .+ \|$", page, re.MULTILINE)
    written = {name: unit.replace(" s-1", "/s") for name, (unit, _) in _STATE.items()}
    assert rows == list(written.items())


def test_the_pages_name_all_that_can_be_required():
    page = (DOCS / "robustness.md").read_text()
    named = set(re.findall(r"`([\w.]+)`", page.partition("## What can be required")[2]))
    assert named >= {*PROBABILITIES, *STATISTICS, "pitch", "heading"}
    measures = [x for x in MEASURES if not x.startswith(("pitch.", "heading."))]
    assert named >= set(measures)


def test_no_page_includes_a_file():
    for path in PAGES:
        assert "--8<--" not in path.read_text(), path


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
