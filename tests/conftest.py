"""Shared set-up: double precision, shape checks, and programs compiled only once."""

import contextlib
import ctypes
import gc
import os
import shutil
import tempfile
import time
from pathlib import Path

import pytest

os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Programs here run once or twice: what the compiler does to make them fast, a quarter
# of its time, does not pay. A flag given from outside wins.
os.environ["XLA_FLAGS"] = " ".join(
    [
        "--xla_force_host_platform_device_count=2 --xla_backend_optimization_level=0",
        os.environ.get("XLA_FLAGS", ""),
    ]
).strip()

from shape_checks import install

# All but the compiler to C, which has text and no shapes: a check of each of its calls,
# 100,000 for a law, takes longer than what it does.
_LIBRARY = Path(__file__).parents[1] / "jaxglider"
_CHECKED = {path.stem for path in _LIBRARY.iterdir()} - {"export", "__init__"}
_EXPORT = {path.stem for path in (_LIBRARY / "export").iterdir()} - {"c", "__init__"}
install(
    [f"jaxglider.{name}" for name in _CHECKED]
    + [f"jaxglider.export.{name}" for name in _EXPORT]
)

import jaxglider

jaxglider.enable_fast_loops()

import jax

jax.config.update("jax_enable_x64", True)
# Even a sum costs 40 ms to compile, and comes again in many tests.
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)

import tuning.cli.main
from jaxglider.core.compiler import cache_folder
from jaxglider.simulation.rollout import evaluate, simulate

KEPT_DAYS = 14
"""Days that a compiled program is kept for later sessions."""
RESIDENT = 3e9
"""Bytes in memory from which a session drops its traces and programs."""


def pytest_configure(config):
    """Compiled programs are kept between sessions, in pytest's own cache.

    Most of a first session goes into compiling. A program is found by what it is and
    what it was compiled with: one that has changed is compiled anew.
    """
    folder = os.environ.get("JAXGLIDER_TEST_CACHE") or _kept_programs(config)
    jax.config.update("jax_compilation_cache_dir", str(folder))


def _kept_programs(config):
    """The folder of this processor's programs, old ones gone."""
    home = cache_folder()
    try:
        folder = config.cache.mkdir(f"programs-{home.name if home else 'any'}")
    except (AttributeError, OSError):  # pytest has no cache, or must not write here
        return tempfile.mkdtemp(prefix="jaxglider-test-cache-")
    oldest = time.time() - 86400 * KEPT_DAYS
    for program in folder.iterdir():
        with contextlib.suppress(FileNotFoundError):  # another session's work
            if program.stat().st_mtime < oldest:
                program.unlink()
    return folder


def pytest_collection_finish():
    """Spares the garbage collector what lives as long as the session.

    JAX makes objects by the million while it traces: at the default threshold a fifth
    of its time went into collections that found nothing.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)


@pytest.fixture(scope="module", autouse=True)
def memory_given_back():
    """Drops JAX's traces and programs after a file of tests that has filled the memory.

    JAX keeps all that it ever traced and compiled. What is dropped is traced again
    where it is needed, so it is dropped seldom. The C library keeps freed pages
    until it is asked for them.
    """
    yield
    if _resident() > RESIDENT:
        jax.clear_caches()
        gc.collect()
        with contextlib.suppress(OSError, TypeError, AttributeError):  # glibc alone
            ctypes.CDLL(None).malloc_trim(0)


def _resident():
    """Bytes of this process in memory; 0 where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


@pytest.fixture
def call(capsys, tmp_path, monkeypatch):
    """Runs a command in an empty folder, JAX as the tests have set it up.

    Returns its exit code, standard output and standard error.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tuning.cli.main, "start_jax", lambda *args, **kwargs: None)

    def run(*arguments):
        try:
            code = tuning.cli.main.main([str(a) for a in arguments])
        except SystemExit as stop:
            code = stop.code
        return code, *capsys.readouterr()

    return run


@pytest.fixture(scope="session")
def evaluate_jit():
    return jax.jit(evaluate)


@pytest.fixture(scope="session")
def simulate_jit():
    return jax.jit(simulate)


@pytest.fixture
def sweep(tmp_path, monkeypatch, capsys):
    """Runs a sweep with toy rollouts; returns exit code, output and complaints."""
    from toy_campaign import Toy

    import tuning.campaign.execute
    import tuning.cli.main

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tuning.cli.main, "start_jax", lambda *a, **k: None)
    monkeypatch.setattr(tuning.campaign.execute, "Engine", Toy)

    def run(text):
        try:
            code = tuning.cli.main.main(text.split())
        except SystemExit as stop:
            code = stop.code
        return code, *capsys.readouterr()

    return run


@pytest.fixture
def kept(sweep, tmp_path, tmp_path_factory):
    """Makes campaigns of the same options only once, then copies of them."""
    from toy_campaign import RUN

    def make(folder, options):
        name = "".join(c if c.isalnum() else "-" for c in options)
        first = tmp_path_factory.getbasetemp() / f"kept{name}"
        if not first.exists():
            assert sweep(f"{RUN} {options} --out {first}")[0] == 0
        shutil.copytree(first, tmp_path / folder)

    return make
