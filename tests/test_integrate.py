import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxglider.core.runge_kutta import RK4, Tableau, runge_kutta_step
from jaxglider.signals import GliderState

EULER = Tableau((0.0,), (0.0,), (1.0,), 1)
MIDPOINT = Tableau((0.0, 0.5), (0.5, 0.0), (0.0, 1.0), 2)
TABLEAUX = [EULER, MIDPOINT, RK4]
NAMES = ["euler", "midpoint", "rk4"]
each_tableau = pytest.mark.parametrize("tableau", TABLEAUX, ids=NAMES)


def _integrate(tableau, slope, start, duration, steps):
    """March a time-dependent slope(time, state); `steps` is traced."""
    step = jnp.asarray(duration) / steps

    def advance(number, state):
        def derivative(state, node):
            return slope((number + node) * step, state)

        return runge_kutta_step(tableau, derivative, state, step)

    return lax.fori_loop(0, steps, advance, start)


@each_tableau
def test_each_method_converges_at_its_order(tableau):
    # y' = y cos t and z' = z² sin t have closed forms and depend on time.
    def slope(time, state):
        y, z = state
        return y * jnp.cos(time), z * z * jnp.sin(time)

    def exact(t):
        return np.exp(np.sin(t)), 1.0 / (1.0 + np.cos(t))

    start = (jnp.asarray(1.0), jnp.asarray(0.5))
    run = jax.jit(lambda steps: _integrate(tableau, slope, start, 1.2, steps))
    counts = (64, 128) if tableau.order == 4 else (512, 1024)
    coarse, fine = (np.abs(np.subtract(run(n), exact(1.2))) for n in counts)
    np.testing.assert_allclose(np.log2(coarse / fine), tableau.order, atol=0.06)


@each_tableau
def test_one_linear_step_is_the_taylor_polynomial_of_its_order(tableau):
    rate, step = -0.7, 0.9
    got = runge_kutta_step(
        tableau, lambda y, _: rate * y, jnp.asarray(2.0), jnp.asarray(step)
    )
    terms = np.cumprod([1.0, *(rate * step / n for n in range(1, tableau.order + 1))])
    np.testing.assert_allclose(got, 2.0 * terms.sum(), rtol=1e-15)


@pytest.mark.parametrize(
    ("tableau", "degree", "wanted"),
    [
        (EULER, 1, 0.0),
        (MIDPOINT, 1, 1 / 2),
        (MIDPOINT, 2, 1 / 4),
        (RK4, 3, 1 / 4),
        (RK4, 4, 5 / 24),
    ],
)
def test_slopes_are_asked_for_at_the_nodes(tableau, degree, wanted):
    # Left end, midpoint and Simpson's rule, on a power of the fraction of the step.
    got = runge_kutta_step(
        tableau, lambda _, node: node**degree, jnp.asarray(0.0), jnp.asarray(1.0)
    )
    np.testing.assert_allclose(got, wanted, rtol=1e-15, atol=1e-300)


@each_tableau
def test_tableau_is_consistent(tableau):
    assert sum(tableau.weights) == pytest.approx(1.0, abs=1e-15)
    assert tableau.nodes[1:] == tableau.links[:-1]
    assert tableau.links[-1] == 0.0


def test_any_pytree_is_integrated_leaf_by_leaf():
    state = {"vector": jnp.array([1.0, 2.0]), "pair": (jnp.asarray(3.0), None)}
    got = runge_kutta_step(
        RK4,
        lambda s, _: jax.tree.map(lambda x: -x, s),
        state,
        jnp.asarray(0.1),
    )
    assert jax.tree.structure(got) == jax.tree.structure(state)
    factor = 1 - 0.1 + 0.1**2 / 2 - 0.1**3 / 6 + 0.1**4 / 24
    np.testing.assert_allclose(got["vector"], [factor, 2 * factor], rtol=1e-15)
    np.testing.assert_allclose(got["pair"][0], 3 * factor, rtol=1e-15)


def test_a_glider_state_is_its_own_derivative_type():
    start = GliderState.at_rest(surge=0.5)

    def derivative(state, node):
        return GliderState.at_rest(north=state.surge, surge=2.0 * node)

    after = runge_kutta_step(RK4, derivative, start, jnp.asarray(1.0))
    # u = 0.5 + t², X = 0.5 t + t³/3.
    np.testing.assert_allclose(after.surge, 1.5, rtol=1e-15)
    np.testing.assert_allclose(after.north, 0.5 + 1 / 3, rtol=1e-15)
    assert float(after.depth) == 0.0


@each_tableau
def test_single_precision_stays_single(tableau):
    state = jnp.asarray(1.0, jnp.float32)
    after = runge_kutta_step(
        tableau, lambda y, node: -y + node, state, jnp.asarray(0.01, jnp.float32)
    )
    assert after.dtype == jnp.float32


def test_gradients_run_through_a_step():
    def final(step, start):
        return runge_kutta_step(RK4, lambda y, _: -y * y, start, step)

    step, start = jnp.asarray(0.1), jnp.asarray(1.3)
    got = jax.grad(final, (0, 1))(step, start)
    h = 1e-5
    by_step = (final(step + h, start) - final(step - h, start)) / (2 * h)
    by_start = (final(step, start + h) - final(step, start - h)) / (2 * h)
    np.testing.assert_allclose(got, (by_step, by_start), rtol=1e-8)
