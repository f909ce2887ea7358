"""The fast-loop options are set with care and never behind the user's back."""

import os
import subprocess
import sys
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider import enable_fast_loops
from jaxglider.core import compiler as _compile
from jaxglider.core.compiler import not_inlined


@pytest.fixture(autouse=True)
def fresh(monkeypatch, tmp_path):
    """A process that has not computed anything yet, as far as the module can tell."""
    monkeypatch.setattr(_compile, "_backend_started", lambda: False)
    monkeypatch.setenv("XLA_FLAGS", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv(_compile.SWITCH, raising=False)


@pytest.fixture
def untried(monkeypatch):
    """A version of XLA that the options were not tried on; counts the probes."""
    probes = []

    def install(returncode):
        def run(command, **options):
            probes.append((command, options))
            return subprocess.CompletedProcess(command, returncode)

        monkeypatch.setattr(_compile.importlib.metadata, "version", lambda _: "9.9.9")
        monkeypatch.setattr(_compile.subprocess, "run", run)
        return probes

    return install


def flags():
    return os.environ["XLA_FLAGS"].split()


def test_options_are_set_once():
    assert enable_fast_loops() is True
    assert flags() == list(_compile.FAST_LOOP_FLAGS)
    assert enable_fast_loops() is True
    assert flags() == list(_compile.FAST_LOOP_FLAGS)


def test_flags_of_the_user_are_kept_and_win(monkeypatch):
    own = "--xla_cpu_prefer_vector_width=256"
    monkeypatch.setenv("XLA_FLAGS", f"--xla_dump_to=/nowhere {own}")
    enable_fast_loops()
    assert flags() == ["--xla_dump_to=/nowhere", own, _compile.FAST_LOOP_FLAGS[0]]


def test_switch_turns_the_options_off(monkeypatch):
    monkeypatch.setenv(_compile.SWITCH, "0")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert enable_fast_loops() is False
    assert flags() == []


def test_call_after_the_first_computation_warns_and_changes_nothing(monkeypatch):
    monkeypatch.setattr(_compile, "_backend_started", lambda: True)
    with pytest.warns(UserWarning, match="came after JAX's first computation"):
        assert enable_fast_loops() is False
    assert flags() == []


def test_backend_of_this_very_process_is_seen_to_have_started(monkeypatch):
    import jax

    monkeypatch.undo()
    jax.devices()
    assert _compile._backend_started() is True


def test_missing_internals_of_jax_count_as_not_started(monkeypatch):
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "jax._src", None)
    assert _compile._backend_started() is False


def test_version_that_refuses_the_options_is_left_alone(untried):
    probes = untried(returncode=1)
    for _ in range(2):
        with pytest.warns(UserWarning, match="refuses the fast-loop options"):
            assert enable_fast_loops() is False
    assert flags() == []
    # The verdict is remembered: one probe serves all later processes.
    assert len(probes) == 1


def test_untried_version_is_probed_once_with_the_options_alone(untried, monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "--xla_dump_to=/nowhere")
    probes = untried(returncode=0)
    assert enable_fast_loops() is True
    assert enable_fast_loops() is True
    assert len(probes) == 1
    _, options = probes[0]
    assert options["env"]["XLA_FLAGS"].split() == list(_compile.FAST_LOOP_FLAGS)


def test_cache_that_cannot_be_written_costs_a_probe_and_nothing_else(
    untried, monkeypatch, tmp_path
):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    probes = untried(returncode=0)
    assert enable_fast_loops() is True
    assert len(probes) == 1


def test_cache_folder_belongs_to_user_and_processor(monkeypatch, tmp_path):
    folder = _compile.cache_folder()
    assert folder == _compile.cache_folder()
    assert folder.parent == tmp_path / "jaxglider"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    at_home = _compile.cache_folder()
    assert at_home.parent == tmp_path / "home" / ".cache" / "jaxglider"
    assert at_home.name == folder.name

    def another(*_, **__):
        return "model name : another\nflags : fpu\n"

    monkeypatch.setattr(_compile.Path, "read_text", another)
    assert _compile.cache_folder().name != folder.name


def test_fresh_process_computes_with_the_options_and_a_bad_one_fails():
    program = (
        "import os, jaxglider, jax\n"
        "assert jaxglider.enable_fast_loops()\n"
        "assert 'small_while_loop' in os.environ['XLA_FLAGS']\n"
        "step = lambda i, x: 0.5 * x + 1.0\n"
        "print(float(jax.jit(lambda x: jax.lax.fori_loop(0, 9, step, x))(0.0)))\n"
    )
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    good = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(good.stdout) == 2 * (1 - 0.5**9)
    # What the probe relies on: XLA ends the process at an option it does not know.
    bad = subprocess.run(
        [sys.executable, "-c", _compile._PROBE],
        env={**environment, "XLA_FLAGS": "--xla_no_such_option=1"},
        capture_output=True,
        check=False,
    )
    assert bad.returncode != 0


def test_options_of_the_backend_that_the_user_gives_are_extended(monkeypatch):
    own = "--xla_backend_extra_options=xla_cpu_disable_loop_unrolling=false,other=1"
    monkeypatch.setenv("XLA_FLAGS", own)
    monkeypatch.setattr(_compile, "_backend_started", lambda: False)
    assert _compile.enable_fast_loops()
    (flag,) = [
        flag
        for flag in os.environ["XLA_FLAGS"].split()
        if flag.startswith("--xla_backend_extra_options=")
    ]
    values = flag.split("=", 1)[1].split(",")
    assert "xla_cpu_small_while_loop_byte_threshold=1000000000" in values
    assert "xla_cpu_disable_loop_unrolling=false" in values
    assert "xla_cpu_disable_loop_unrolling=true" not in values


def test_a_function_apart_is_called_and_not_merged_and_stays_itself():
    def wave(x):
        return jnp.sin(x) * x, jnp.clip(x, -1.0, 1.0)

    kept, x = not_inlined(wave), jnp.linspace(-2.0, 2.0, 7)
    lowered = jax.jit(lambda x: kept(x)[0] + kept(x)[1]).lower(x).as_text()
    calls = [line for line in lowered.splitlines() if "call @" in line]
    marked = [line for line in calls if 'inlineable = "false"' in line]
    assert len(marked) == 2
    # What is called inside it, as the clip is, is merged as ever.
    assert all("wave" in line for line in marked)
    assert len(calls) > len(marked)
    for ours, plain in zip(kept(x), wave(x), strict=True):
        np.testing.assert_array_equal(ours, plain)
    slope = jax.vmap(jax.grad(lambda x: kept(x)[0]))(x)
    np.testing.assert_allclose(slope, np.sin(x) + x * np.cos(x), rtol=1e-14)
    _, tangent = jax.jvp(lambda x: kept(x)[0], (x,), (jnp.ones_like(x),))
    np.testing.assert_allclose(tangent, slope, rtol=1e-14)
