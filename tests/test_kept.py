"""Programs that are traced once for all processes."""

import functools
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider.core.batching import map_members
from jaxglider.core.kept import fingerprint as digests
from jaxglider.core.kept import programs
from jaxglider.core.kept.fingerprint import code_fingerprint
from jaxglider.core.kept.programs import keep_programs, kept

TRACED = []
X = jnp.arange(3.0)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder that programs are kept in, also those of this file."""
    monkeypatch.setattr(digests, "PINNED", (*digests.PINNED, __name__))
    monkeypatch.delenv(programs.SWITCH, raising=False)
    keep_programs(tmp_path / "traces")
    TRACED.clear()
    yield tmp_path / "traces"
    keep_programs(None)


def scaled(factor):
    def function(x):
        TRACED.append(factor)
        return {"value": factor * jnp.sin(x), "factor": 2}

    return function


def anew(function, *arguments):
    """What a new process does: nothing of the one before but its files."""
    return kept(function)(*arguments)


def test_a_second_process_does_not_trace(folder):
    first = anew(scaled(2.0), X)
    again = anew(scaled(2.0), X)
    assert TRACED == [2.0]
    assert len(list(folder.iterdir())) == 1
    np.testing.assert_array_equal(first["value"], 2.0 * np.sin(X))
    np.testing.assert_array_equal(again["value"], first["value"])
    assert again["factor"] == 2


@pytest.mark.parametrize(
    ("change", "arguments"),
    [
        (scaled(3.0), (X,)),
        (scaled(jnp.asarray(2.0)), (X,)),
        (scaled(2.0), (jnp.arange(4.0),)),
        (scaled(2.0), (X.astype(jnp.float32),)),
    ],
    ids=["value", "type of a value", "shape", "precision"],
)
def test_what_differs_is_traced_anew(folder, change, arguments):
    anew(scaled(2.0), X)
    TRACED.clear()
    result = anew(change, *arguments)
    assert len(TRACED) == 1
    np.testing.assert_allclose(result["value"], TRACED[0] * np.sin(arguments[0]))


def test_other_source_is_traced_anew(folder, monkeypatch):
    anew(scaled(2.0), X)
    monkeypatch.setattr(programs, "_source", lambda: "edited")
    anew(scaled(2.0), X)
    assert len(TRACED) == 2


def test_other_flags_and_settings_are_traced_anew(folder, monkeypatch):
    anew(scaled(2.0), X)
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_enable_fast_math=false")
    anew(scaled(2.0), X)
    with jax.default_matmul_precision("highest"):
        anew(scaled(2.0), X)
    assert len(TRACED) == 3


def test_the_digest_of_the_source_changes_with_any_file(tmp_path, monkeypatch):
    (tmp_path / "gain.py").write_text("K = 1\n")

    class Found:
        submodule_search_locations = (str(tmp_path),)

    monkeypatch.setattr(programs.importlib.util, "find_spec", lambda name: Found)
    programs._source.cache_clear()
    before = programs._source()
    (tmp_path / "gain.py").write_text("K = 2\n")
    programs._source.cache_clear()
    after = programs._source()
    programs._source.cache_clear()
    assert before != after


def test_a_broken_file_is_replaced(folder):
    anew(scaled(2.0), X)
    (path,) = folder.iterdir()
    path.write_bytes(path.read_bytes()[:40])
    np.testing.assert_array_equal(anew(scaled(2.0), X)["value"], 2.0 * np.sin(X))
    anew(scaled(2.0), X)
    assert len(TRACED) == 2


def test_code_that_leans_on_unknown_files_is_not_kept(folder, monkeypatch):
    monkeypatch.setattr(digests, "PINNED", digests.PINNED[:-1])
    for _ in range(2):
        anew(scaled(2.0), X)
    assert len(TRACED) == 2
    assert not folder.exists()


def test_what_jax_cannot_write_down_is_traced_as_ever(folder):
    def called_back(x):
        return jax.pure_callback(np.sin, jax.typeof(x), x)

    np.testing.assert_allclose(anew(called_back, X), np.sin(X), rtol=1e-6)
    assert not folder.exists()

    def wrong(x):
        raise ValueError("a fault of its own")

    with pytest.raises(ValueError, match="a fault of its own"):
        anew(wrong, X)


@pytest.mark.parametrize("value", ["0", "1"])
def test_keeping_is_switched_off_by_the_environment(folder, monkeypatch, value):
    monkeypatch.setenv(programs.SWITCH, value)
    keep_programs(folder)
    anew(scaled(2.0), X)
    assert folder.exists() == (value == "1")


def test_within_a_trace_it_is_the_function_itself(folder):
    run = kept(scaled(2.0))
    slopes = jax.vmap(jax.grad(lambda x: run(x)["value"]))(X)
    np.testing.assert_allclose(slopes, 2.0 * np.cos(X))
    assert not folder.exists()


def drawn(key, members, name, scale):
    TRACED.append(name)
    noise = jax.random.normal(key, ())
    lanes = map_members(lambda x: x + noise, members, devices=jax.devices())
    return lanes, jnp.linalg.solve(scale * jnp.eye(3), lanes[:3]), name


def test_keys_lanes_on_two_devices_and_solvers_come_back(folder):
    assert len(jax.devices()) == 2
    inputs = jax.random.key(1), np.arange(8.0), "name", 2.0
    lanes, solved, _ = eqx.filter_jit(drawn)(*inputs)
    TRACED.clear()
    for _ in range(2):
        result = anew(drawn, *inputs)
        np.testing.assert_array_equal(result[0], lanes)
        np.testing.assert_array_equal(result[1], solved)
        assert result[2] == "name"
    # What lies on two devices is taken from there.
    np.testing.assert_allclose(
        anew(drawn, inputs[0], result[0], *inputs[2:])[0], 2 * lanes - inputs[1]
    )
    assert TRACED == ["name"]


def test_only_the_programs_used_last_stay(folder, monkeypatch):
    monkeypatch.setattr(programs, "_MOST", 2)
    for factor in (1.0, 2.0):
        anew(scaled(factor), X)
        time.sleep(0.02)
    anew(scaled(1.0), X)
    time.sleep(0.02)
    anew(scaled(3.0), X)
    TRACED.clear()
    for factor in (1.0, 3.0, 2.0):
        anew(scaled(factor), X)
    assert TRACED == [2.0]


class Law(eqx.Module):
    gain: jax.Array

    def __call__(self, x):
        return self.gain * x


def test_a_fingerprint_of_code_tells_what_the_code_holds(monkeypatch):
    monkeypatch.setattr(digests, "PINNED", (*digests.PINNED, __name__))

    def around(x):
        return lambda y: x + y

    one, two = Law(jnp.asarray(1.0)), Law(jnp.asarray(2.0))
    made = [
        *(around(1), around(2), one, two, one.__call__, two.__call__),
        *(functools.partial(scaled, 1), functools.partial(scaled, 2)),
        *(jax.grad(one), jax.grad(two), jax.value_and_grad(one), kept(one), kept(two)),
        *(lambda x: x, lambda x: x + 1),
    ]
    found = [code_fingerprint(x) for x in made]
    assert len(set(found)) == len(found)
    assert found == [code_fingerprint(x) for x in made]
    assert code_fingerprint(around(1)) == found[0]


@pytest.mark.parametrize(
    "held", [object(), pytest, time.sleep], ids=["object", "module", "builtin"]
)
def test_what_cannot_be_told_has_no_fingerprint(held):
    with pytest.raises(TypeError, match="no fingerprint"):
        code_fingerprint(held)


def test_a_traced_number_has_no_fingerprint():
    with pytest.raises(TypeError, match="traced"):
        jax.jit(code_fingerprint)(1.0)
