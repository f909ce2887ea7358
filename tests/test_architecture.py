"""Imports point downward, and importing the package has no side effects."""

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import jaxglider

PACKAGE = Path(jaxglider.__file__).parent
ROOT = PACKAGE.parent
PACKAGES = ("jaxglider", "tuning")
ROOMS = (
    "jaxglider.core.kept",
    "jaxglider.core",
    "jaxglider.signals",
    "jaxglider.vehicle",
    "jaxglider.environment",
    "jaxglider.guidance",
    "jaxglider.control.prescribed",
    "jaxglider.control",
    "jaxglider.control.flown",
    "jaxglider.control.textbook",
    "jaxglider.control.catalogue",
    "jaxglider.navigation.sensing",
    "jaxglider.navigation",
    "jaxglider.trim",
    "jaxglider.simulation",
    "jaxglider.simulation.checks",
    "jaxglider.uncertainty",
    "jaxglider.onboard",
    "jaxglider.paper.tuned",
    "jaxglider.paper",
    "jaxglider.files.flight",
    "jaxglider.files.sea",
    "jaxglider.files.settings",
    "jaxglider.files",
    "jaxglider.files.records",
    "jaxglider.plotting",
    "jaxglider.export.c",
    "jaxglider.export",
    "jaxglider",
    "tuning.reporting",
    "tuning.space",
    "tuning.gradient_check",
    "tuning.problem",
    "tuning.search",
    "tuning.campaign.run",
    "tuning.campaign.analysis",
    "tuning.campaign.report",
    "tuning.campaign",
    "tuning.evaluation",
    "tuning.identification.record",
    "tuning.identification.information",
    "tuning.identification",
    "tuning.identification.report",
    "tuning.api",
    "tuning",
    "tuning.cli.options",
    "tuning.cli.session",
    "tuning.cli.commands.identification",
    "tuning.cli.commands",
    "tuning.cli",
    "tuning.__main__",
)
"""The rooms of the house, each a folder or a module of its own, from the ground up."""
MOST_IN_A_FOLDER, MOST_LOOSE = 13, 3


def room(module):
    """The room of a module: itself if it is one, else its folder; None for neither."""
    if module in ROOMS:
        return module
    folder = module.rpartition(".")[0]
    return folder if folder in ROOMS and folder not in PACKAGES else None


def module_name(path, root=ROOT):
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def is_module(name):
    path = ROOT.joinpath(*name.split("."))
    return path.with_suffix(".py").exists() or (path / "__init__.py").exists()


def imports(text, module, is_package=False):
    """Modules that a text imports, at its top or inside functions."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = module.split(".")
                above = parts[: len(parts) - node.level + is_package]
                base = ".".join([*above, base] if base else above)
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                yield whole if is_module(whole) else base


def upward(text, module, is_package=False):
    """Imports of a text that go up the list of rooms, or to no room at all."""
    own = ROOMS.index(room(module))
    for name in imports(text, module, is_package):
        if name.split(".")[0] not in PACKAGES:
            continue
        target = room(name)
        if target is None or ROOMS.index(target) > own:
            yield name


def sources(package=PACKAGES):
    packages = [package] if isinstance(package, str) else package
    return sorted(path for p in packages for path in (ROOT / p).rglob("*.py"))


@pytest.mark.parametrize("path", sources(), ids=module_name)
def test_module_is_in_a_room_and_imports_nothing_above_it(path):
    name, is_package = module_name(path), path.name == "__init__.py"
    assert room(name) is not None, f"{name} is in no room of the house"
    assert not list(upward(path.read_text(), name, is_package))


@pytest.mark.parametrize(
    "module",
    [
        "jaxglider.helpers",
        "jaxglider.piloting.filter",
        "tuning.more",
        "tuning.cli.sub.more",
    ],
)
def test_a_module_outside_the_house_is_found(module):
    assert room(module) is None


def test_no_room_is_listed_that_does_not_exist():
    assert all(is_module(name) for name in ROOMS)
    assert len(set(ROOMS)) == len(ROOMS)


def test_no_folder_holds_too_much():
    for package in PACKAGES:
        folders = [
            ROOT / package,
            *(p for p in (ROOT / package).rglob("*") if p.is_dir()),
        ]
        for folder in folders:
            files = [p for p in folder.iterdir() if p.is_file() and p.suffix != ".pyc"]
            assert len(files) <= MOST_IN_A_FOLDER, f"{folder}: {len(files)} files"
        loose = [p for p in (ROOT / package).glob("*.py") if p.name[0] != "_"]
        assert len(loose) <= MOST_LOOSE


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("jaxglider.core.numerics", "from jaxglider.signals import GliderState"),
        ("jaxglider.core.rotations", "def f():\n    import jaxglider.paper"),
        ("jaxglider.control.observer", "from jaxglider.simulation import rollout"),
        ("jaxglider.simulation.rollout", "from ..files import results"),
        ("jaxglider.vehicle.plant", "from ..control.controller import tracking_error"),
        ("jaxglider.simulation.metrics", "from tuning.space.space import Space"),
        ("jaxglider.paper", "from jaxglider import ClosedLoop"),
        ("tuning.space.space", "from tuning.problem.case import FlightCase"),
        ("tuning.problem.problem", "from tuning.cli.options import tune"),
        ("tuning.search.descent", "from tuning import sweep"),
        ("tuning.space.space", "import tuning.helpers"),
    ],
)
def test_upward_import_is_found(module, text):
    assert list(upward(text, module))


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("jaxglider.signals", "from jaxglider.core import rotations"),
        (
            "jaxglider.simulation.metrics",
            "from jaxglider.control.prescribed.funnel import Limits",
        ),
        ("jaxglider.vehicle.plant", "from .moving_mass import Effectiveness"),
        ("jaxglider.files.results", "import jaxglider.paper"),
        ("jaxglider.paper", "import numpy"),
        ("tuning.problem.problem", "from jaxglider import ClosedLoop"),
        ("tuning.cli.main", "from tuning.cli.commands.tune import tune"),
    ],
)
def test_downward_import_is_allowed(module, text):
    assert not list(upward(text, module))


def dotted(node):
    """`jax.config` of an expression such as jax.config.update, else an empty text."""
    parts = []
    while isinstance(node, ast.Attribute):
        parts.append(node.attr)
        node = node.value
    return ".".join([node.id, *reversed(parts)]) if isinstance(node, ast.Name) else ""


def global_settings(text):
    """Places where a text reaches for the settings of JAX or writes the environment."""
    for node in ast.walk(ast.parse(text)):
        name = dotted(node)
        if name == "jax.config" or name in ("os.putenv", "os.unsetenv"):
            yield name
        elif isinstance(node, ast.ImportFrom) and node.module == "jax":
            yield from ("jax.config" for a in node.names if a.name == "config")
        elif isinstance(node, ast.Assign | ast.Delete):
            targets = node.targets
            for target in targets:
                if isinstance(target, ast.Subscript):
                    yield from {dotted(target.value)} & {"os.environ"}
        elif isinstance(node, ast.Call) and dotted(node.func).startswith("os.environ."):
            method = dotted(node.func).rsplit(".", 1)[1]
            if method in ("update", "setdefault", "pop", "clear"):
                yield f"os.environ.{method}"


@pytest.mark.parametrize("path", sources("jaxglider"), ids=module_name)
def test_module_leaves_settings_alone(path):
    # The switch for fast loops is a call that the user makes; a program that is kept
    # is told by the settings it was traced with, which are read.
    allowed = {"compiler.py": {"os.environ"}, "programs.py": {"jax.config"}}
    text = path.read_text()
    assert set(global_settings(text)) <= allowed.get(path.name, set())
    assert set(re.findall(r"jax\.config\b(.{7})", text)) <= {".values"}


@pytest.mark.parametrize(
    "text",
    [
        "import jax\njax.config.update('jax_enable_x64', True)",
        "from jax import config",
        "import os\nos.environ['XLA_FLAGS'] = ''",
        "import os\nos.environ.setdefault('XLA_FLAGS', '')",
        "import os\ndel os.environ['XLA_FLAGS']",
    ],
)
def test_touched_setting_is_found(text):
    assert list(global_settings(text))


LOOK = """
import importlib, json, logging, os, pkgutil, sys
import jax, numpy, warnings
from jax._src import xla_bridge

def settings():
    return {
        "environment": dict(os.environ),
        "jax": {k: repr(v) for k, v in jax.config.values.items()},
        "numpy": repr(numpy.get_printoptions()),
        "handlers": repr(logging.getLogger().handlers),
        "warnings": repr(warnings.filters),
    }

def changed(before):
    return [k for k, v in settings().items() if before[k] != v]

before = settings()
import jaxglider
front = {
    "started": xla_bridge.backends_are_initialized(),
    "changed": changed(before),
    "loaded": [n for n in sys.modules if n.split(".")[0] in ("tuning", "matplotlib")],
}
# What they do to the process is their own affair.
import matplotlib.figure, netCDF4
before = settings()
for module in pkgutil.walk_packages(jaxglider.__path__, "jaxglider."):
    importlib.import_module(module.name)
print(json.dumps({
    "front": front,
    "started": xla_bridge.backends_are_initialized(),
    "changed": changed(before),
    "tuning": [n for n in sys.modules if n.split(".")[0] == "tuning"],
}))
"""


@pytest.fixture(scope="module")
def fresh_import():
    run = subprocess.run(
        [sys.executable, "-c", LOOK],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)},
    )
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_import_starts_no_backend(fresh_import):
    assert fresh_import["front"]["started"] is False
    assert fresh_import["started"] is False


def test_import_brings_neither_the_tuner_nor_the_plotter_along(fresh_import):
    assert fresh_import["front"]["loaded"] == []
    assert fresh_import["tuning"] == []


def test_import_changes_no_setting_of_the_process(fresh_import):
    assert fresh_import["front"]["changed"] == []
    assert fresh_import["changed"] == []
