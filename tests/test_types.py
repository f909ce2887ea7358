import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxglider.core.containers import (
    Container,
    as_float,
    check_finite,
    check_interval,
    concrete,
)


class Pair(Container):
    first: jax.Array = eqx.field(converter=as_float)
    second: jax.Array | None = eqx.field(converter=as_float, default=None)


@pytest.mark.parametrize(
    "given",
    [2, 2.0, np.float32(2.0), np.int64(2), np.array(2), np.array(2.0, np.float32)],
    ids=lambda given: type(given).__name__,
)
def test_numbers_become_strong_arrays_of_the_default_precision(given):
    converted = as_float(given)
    assert isinstance(converted, jax.Array)
    assert converted.dtype == jnp.float64
    assert not converted.aval.weak_type
    assert float(converted) == 2.0


@pytest.mark.parametrize("dtype", [jnp.float16, jnp.float32, jnp.float64])
def test_floating_arrays_keep_their_precision(dtype):
    assert as_float(jnp.ones(3, dtype)).dtype == dtype


def test_lists_become_series():
    np.testing.assert_array_equal(as_float([1, 2.5]), [1.0, 2.5])
    assert as_float([1, 2]).dtype == jnp.float64


def test_a_weakly_typed_array_becomes_a_strong_one_of_equal_value():
    weak = jnp.asarray(0.3)
    assert weak.aval.weak_type
    strong = as_float(weak)
    assert not strong.aval.weak_type
    assert strong.dtype == weak.dtype
    assert float(strong) == 0.3


def test_a_weakly_typed_tracer_becomes_a_strong_one():
    assert not jax.eval_shape(as_float, 0.3).weak_type
    assert jax.eval_shape(lambda x: x + 1.0, 0.3).weak_type


def test_a_traced_integer_becomes_a_traced_float():
    out = jax.eval_shape(as_float, jax.ShapeDtypeStruct((), jnp.int32))
    assert out.dtype == jnp.float64


@pytest.mark.parametrize("thing", [None, True, "word", object(), sum, (1.0, 2.0)])
def test_what_is_no_number_passes_unchanged(thing):
    assert as_float(thing) is thing


def test_a_traced_value_has_no_concrete_one():
    seen = []

    def look(x):
        seen.append(concrete(x))
        return x

    jax.make_jaxpr(look)(1.0)
    assert seen == [None]
    assert concrete("word") is None
    assert concrete(jnp.array(1.5)) == 1.5


@pytest.mark.parametrize(
    ("value", "interval", "rule"),
    [
        (0.0, {"low": 0.0}, "positive"),
        (-1e-300, {"low": 0.0, "closed_low": True}, "zero or positive"),
        (1.0, {"low": 1.0}, "above 1"),
        (0.5, {"low": 1.0, "closed_low": True}, "at least 1"),
        (2.0, {"high": 2.0}, "below 2"),
        (2.5, {"high": 2.0, "closed_high": True}, "at most 2"),
        (1.0, {"low": 0.0, "high": 1.0}, "in (0, 1)"),
        (0.0, {"low": 0.0, "high": 1.0, "closed_high": True}, "in (0, 1]"),
        (1.0, {"low": 0.0, "high": 1.0, "closed_low": True}, "in [0, 1)"),
        (float("nan"), {"low": 0.0}, "positive"),
        (float("inf"), {"low": 0.0}, "positive"),
    ],
)
def test_a_value_outside_its_interval_is_refused_by_name_rule_and_value(
    value, interval, rule
):
    with pytest.raises(ValueError, match=r"Owner\.name must be ") as refusal:
        check_interval("Owner", "name", value, **interval, remedy="Do this.")
    text = str(refusal.value)
    assert f"must be {rule};" in text
    assert f"received {np.asarray(value)}." in text
    assert text.endswith(" Do this.")


@pytest.mark.parametrize(
    ("value", "interval"),
    [
        (1e-300, {"low": 0.0}),
        (0.0, {"low": 0.0, "closed_low": True}),
        (1.0, {"low": 0.0, "high": 1.0, "closed_high": True}),
        (np.array([0.2, 0.8]), {"low": 0.0, "high": 1.0}),
        (None, {"low": 0.0}),
    ],
)
def test_a_value_inside_its_interval_passes(value, interval):
    check_interval("Owner", "name", value, **interval)


def test_one_bad_entry_of_an_array_is_enough():
    with pytest.raises(ValueError, match="positive"):
        check_interval("Owner", "name", jnp.array([1.0, -1.0]), low=0.0)


def test_a_traced_value_is_not_checked():
    def build(x):
        check_interval("Owner", "name", x, low=0.0)
        check_finite("Owner", "name", x)
        return x

    assert float(jax.jit(build)(-1.0)) == -1.0


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_a_container_refuses_numbers_that_are_not_finite(bad):
    with pytest.raises(ValueError, match=r"Pair\.second must be finite; received"):
        Pair(1.0, bad)
    with pytest.raises(ValueError, match=r"Pair\.first must be finite; received"):
        Pair([0.0, bad])


def test_a_container_survives_flattening_without_being_checked_again():
    leaves, shape = jax.tree.flatten(Pair(1.0, 2.0))
    rebuilt = jax.tree.unflatten(shape, [float("nan"), None])
    assert len(leaves) == 2
    assert rebuilt.second is None


def test_containers_of_python_and_of_array_numbers_share_one_trace():
    traces = []

    @jax.jit
    def total(pair):
        traces.append(None)
        return pair.first + pair.second

    total(Pair(1.0, 2))
    total(Pair(jnp.asarray(3.0), np.float32(4.0)))
    assert len(traces) == 1
