"""A function that is one operation to JAX behaves as the function itself does."""

import threading
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.extend.core import jaxpr_as_fun

from jaxglider.core.traced_once import KEPT, traced_once

X, Y = 0.7, jnp.asarray([0.3, -1.2, 2.0])


def pair(x, y):
    """Two results, of which the second depends on y alone, and a whole number."""
    return {"both": jnp.sin(x) * y, "one": jnp.exp(0.1 * y), "count": jnp.int32(3)}


def total(function):
    def of(x, y):
        result = function(x, y)
        return jnp.sum(result["both"] * result["one"]) * result["count"]

    return of


WAYS = {
    "value": lambda f: f,
    "gradient": lambda f: jax.grad(f, argnums=(0, 1)),
    "of one": lambda f: jax.value_and_grad(f, argnums=1),
    "forward": lambda f: jax.jacfwd(f, argnums=1),
    "forward over reverse": lambda f: jax.hessian(f, argnums=(0, 1)),
    "reverse over reverse": lambda f: jax.jacrev(jax.jacrev(f, argnums=1)),
    "lanes": lambda f: lambda x, y: jax.vmap(f, (None, 0))(x, jnp.stack([y, 2.0 * y])),
    "last axis": lambda f: lambda x, y: jax.vmap(f, (0, 1))(y, jnp.outer(y, y)),
    "lanes of gradients": lambda f: lambda x, y: jax.vmap(jax.grad(f), (0, None))(y, y),
    "gradient of lanes": lambda f: jax.grad(
        lambda x, y: jax.vmap(f, (0, None))(x * y, y).sum(), argnums=(0, 1)
    ),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "eager"])
def test_it_is_the_function_under_every_transformation(way, compiled):
    wanted = WAYS[way](total(pair))
    found = WAYS[way](total(traced_once(pair)))
    if compiled:
        wanted, found = jax.jit(wanted), jax.jit(found)
    for a, b in zip(*(jax.tree.leaves(f(X, Y)) for f in (wanted, found)), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-14, atol=1e-15)


class Walk(eqx.Module):
    """A pendulum, a number that only it itself depends on, and a count."""

    angle: jax.Array
    rate: jax.Array
    idle: jax.Array
    ticks: jax.Array


def swing(stiffness, walk, push):
    rate = walk.rate - 0.1 * stiffness * jnp.sin(walk.angle) + push
    idle = jnp.cosh(walk.idle)
    return Walk(walk.angle + 0.1 * rate, rate, idle, walk.ticks + 1)


def end(step, ticks=20):
    def of(stiffness):
        start = Walk(jnp.float64(1.0), jnp.float64(0.0), jnp.float64(0.0), jnp.int32(0))
        pushes = jnp.linspace(0.0, 0.01, ticks)
        last, _ = lax.scan(lambda w, p: (step(stiffness, w, p), None), start, pushes)
        return last.angle**2 + 0.0 * last.ticks

    return of


def test_a_loop_of_it_has_the_values_and_gradients_of_the_loop():
    gains = jnp.asarray([0.5, 1.0, 2.0])
    found, wanted = (
        jax.jit(jax.vmap(jax.value_and_grad(end(step))))(gains)
        for step in (traced_once(swing), swing)
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-13)
    assert np.all(np.abs(found[1]) > 1e-3)


def test_what_no_result_depends_on_is_not_computed():
    # XLA cannot see it: the idle number depends on itself from tick to tick.
    for way in (jax.jit, lambda f: jax.jit(jax.grad(f))):
        text = way(end(traced_once(swing))).lower(1.0).as_text()
        assert "sine" in text
        assert "cosh" not in text
    idle = jax.jit(lambda w: traced_once(swing)(1.0, w, 0.0).idle)
    start = Walk(*(jnp.float64(1.0),) * 3, jnp.int32(0))
    assert "cosh" in idle.lower(start).as_text()


def test_it_is_traced_once_for_all_programs_of_one_precision():
    calls = []

    def counted(*arguments):
        calls.append(arguments)
        return swing(*arguments)

    step = traced_once(counted)
    for ticks in (3, 4):
        jax.jit(jax.vmap(jax.value_and_grad(end(step, ticks))))(jnp.ones(2))
        jax.jit(end(step, ticks))(jnp.float64(1.0))
    assert len(calls) == 1
    single = jax.tree.map(lambda x: x.astype(jnp.float32), (X * Y)[:2])
    jax.eval_shape(step, single[0], Walk(*single, single[0], jnp.int32(0)), single[1])
    assert len(calls) == 2


def test_as_many_traces_are_kept_as_it_says():
    calls = []

    def counted(x):
        calls.append(x)
        return 2.0 * x

    double = traced_once(counted)
    for size in [*range(1, KEPT + 2), KEPT + 1, 1]:
        jax.jit(lambda x: double(x)).lower(jax.ShapeDtypeStruct((size,), jnp.float32))
    assert len(calls) == KEPT + 2


class Loose(eqx.Module):
    """Holds what cannot be hashed."""

    x: jax.Array
    numbers: list[float] = eqx.field(static=True)


def test_static_fields_that_cannot_be_compared_are_traced_each_time():
    step = traced_once(lambda part: part.x * sum(part.numbers))
    for number in (1.0, 2.0):
        part = Loose(jnp.float64(3.0), [number, number])
        assert step(part) == 6.0 * number


def test_threads_that_trace_at_once_do_not_wait_for_each_other_for_ever():
    """One stops in the middle of a trace; the other wants the lanes of its own."""
    begun = threading.Event()
    other = traced_once(lambda x: jnp.cos(x) * x)
    graph = jax.make_jaxpr(traced_once(lambda x: jnp.sin(x) * x))(0.5)

    @traced_once
    def slow(x):
        begun.set()
        time.sleep(0.3)
        return jnp.sum(jax.vmap(other)(x))

    def second():
        begun.wait()
        jax.vmap(jaxpr_as_fun(graph))(jnp.ones(3))

    threads = [
        threading.Thread(target=work, daemon=True)
        for work in (lambda: jax.jit(slow)(jnp.ones(3)), second)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert not any(thread.is_alive() for thread in threads)


def test_threads_that_want_the_same_trace_share_it():
    calls, found = [], []

    def slow(x):
        calls.append(x)
        for _ in range(200):
            x = jnp.sin(x)
        return x

    step = traced_once(slow)
    threads = [
        threading.Thread(target=lambda: found.append(jax.jit(jax.grad(step))(0.5)))
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(calls) == 1
    assert len(found) == 3
    assert len(set(map(float, found))) == 1
