"""Imports point downward, and importing the package has no side effects."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import jaxglider

PACKAGE = Path(jaxglider.__file__).parent
LAYERS = (
    (
        "elementary",
        "numerics",
        "frames",
        "integrate",
        "distributions",
        "designs",
        "_types",
        "_compile",
        "gradient",
    ),
    ("signals", "vehicle", "disturbances", "sensors", "performance", "transform"),
    ("references", "observer", "controllers"),
    (
        "scenario",
        "tick",
        "closed_loop",
        "rollout",
        "autopilot",
        "guard",
        "trajectory",
        "ensemble",
        "uncertainty",
        "quantities",
        "metrics",
    ),
    ("paper",),
)
HOST = len(LAYERS)
"""Layer of all that is not named above: files, figures and whatever is new."""


def layer(module):
    """Number of the layer of a module, by its dotted name; the package is the top."""
    part = module.partition(".")[2].split(".")[0]
    return next((n for n, names in enumerate(LAYERS) if part in names), HOST)


def module_name(path, root=PACKAGE):
    parts = path.relative_to(root.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def is_module(name):
    path = PACKAGE.parent.joinpath(*name.split("."))
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
    """Imports of a text that break the order of the layers."""
    for name in imports(text, module, is_package):
        top = name.split(".")[0]
        above = top == "jaxglider" and layer(name) > layer(module)
        if above or top == "tuning":
            yield name


def sources():
    return sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


@pytest.mark.parametrize("path", sources(), ids=module_name)
def test_module_imports_nothing_above_it(path):
    name, is_package = module_name(path), path.name == "__init__.py"
    assert not list(upward(path.read_text(), name, is_package))


def test_front_door_does_not_import_the_tuner():
    found = imports((PACKAGE / "__init__.py").read_text(), "jaxglider", True)
    assert all(name.split(".")[0] == "jaxglider" for name in found)


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("jaxglider.numerics", "from jaxglider.signals import GliderState"),
        ("jaxglider.frames", "def f():\n    import jaxglider.paper"),
        ("jaxglider.observer", "from jaxglider import rollout"),
        ("jaxglider.rollout", "from . import io"),
        ("jaxglider.vehicle.plant", "from ..controllers.base import Limits"),
        ("jaxglider.metrics", "from tuning.space import encode"),
        ("jaxglider.paper", "from jaxglider import ClosedLoop"),
    ],
)
def test_upward_import_is_found(module, text):
    assert list(upward(text, module))


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("jaxglider.signals", "from jaxglider import frames"),
        ("jaxglider.metrics", "from jaxglider.controllers.base import Limits"),
        ("jaxglider.vehicle.plant", "from .actuation import Effectiveness"),
        ("jaxglider.io", "import jaxglider.paper"),
        ("jaxglider.paper", "import numpy"),
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


@pytest.mark.parametrize("path", sources(), ids=module_name)
def test_module_leaves_settings_alone(path):
    # The switch for fast loops is a call that the user makes.
    allowed = {"os.environ"} if path.name == "_compile.py" else set()
    assert set(global_settings(path.read_text())) <= allowed


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
