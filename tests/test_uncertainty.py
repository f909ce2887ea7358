import dataclasses

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from jaxglider.ensemble import member_keys
from jaxglider.vehicle.parameters import UNCERTAIN, load_vehicle
from jaxglider.vehicle.uncertainty import UniformUncertainty

NOMINAL = load_vehicle("seawing").parameters
MEMBERS = 4000


@pytest.fixture(scope="module")
def shares():
    """(sample / nominal - 1) / half width, one row of members for each parameter."""
    law = UniformUncertainty(0.2)
    sample = jax.jit(jax.vmap(lambda key: law.sample(key, NOMINAL)))(
        member_keys(2, MEMBERS)
    )
    return {
        name: (np.asarray(getattr(sample, name)) / float(getattr(NOMINAL, name)) - 1.0)
        / 0.2
        for name in UNCERTAIN
    }


def test_samples_stay_within_their_bounds_and_fill_them(shares):
    for name, share in shares.items():
        assert share.min() >= -1.0 - 1e-12, name
        assert share.max() <= 1.0 + 1e-12, name
        # The chance that 4000 draws leave the outer half per cent empty is 2e-9.
        assert share.min() < -0.99, name
        assert share.max() > 0.99, name


def test_samples_have_the_mean_and_the_spread_of_a_uniform_law(shares):
    table = np.stack(list(shares.values()))
    # Standard errors at 4000 draws: 0.009 for the mean, 0.004 for the spread.
    np.testing.assert_allclose(table.mean(axis=1), 0.0, atol=0.04)
    np.testing.assert_allclose(table.std(axis=1), 1 / np.sqrt(3), atol=0.02)


def test_parameters_are_drawn_independently(shares):
    correlation = np.corrcoef(np.stack(list(shares.values())))
    np.testing.assert_allclose(correlation, np.eye(len(UNCERTAIN)), atol=0.075)


def test_known_parameters_are_untouched():
    sample = UniformUncertainty(0.2).sample(jr.key(0), NOMINAL)
    for field in dataclasses.fields(NOMINAL):
        same = float(getattr(sample, field.name)) == float(getattr(NOMINAL, field.name))
        assert same == (field.name not in UNCERTAIN)


def test_a_draw_does_not_move_when_another_name_is_added_or_the_order_changes():
    key = jr.key(9)

    def drawn(*names):
        sample = UniformUncertainty(0.3, names).sample(key, NOMINAL)
        return {name: float(getattr(sample, name)) for name in names}

    alone = drawn("drag")
    pair = drawn("moving_mass", "drag")
    assert pair["drag"] == alone["drag"] != float(NOMINAL.drag)
    assert drawn("drag", "moving_mass") == pair
    assert drawn(*UNCERTAIN)["drag"] == alone["drag"]


def test_equal_keys_give_equal_samples_and_other_keys_others():
    law = UniformUncertainty(0.2)
    first, again, other = (
        law.sample(key, NOMINAL) for key in (jr.key(1), jr.key(1), jr.key(2))
    )
    for name in UNCERTAIN:
        assert float(getattr(first, name)) == float(getattr(again, name))
        assert float(getattr(first, name)) != float(getattr(other, name))


def test_the_half_width_scales_one_and_the_same_draw():
    key = jr.key(4)

    def deviation(half_width):
        sample = UniformUncertainty(half_width).sample(key, NOMINAL)
        return float(sample.drag / NOMINAL.drag) - 1.0

    assert deviation(0.0) == 0.0
    np.testing.assert_allclose(deviation(0.4), 2 * deviation(0.2), rtol=1e-12)


def test_single_precision_parameters_give_single_precision_samples():
    single = jax.tree.map(lambda x: x.astype(jnp.float32), NOMINAL)
    law = UniformUncertainty(jnp.asarray(0.2, jnp.float32))
    leaves = jax.tree.leaves(law.sample(jr.key(0), single))
    assert all(leaf.dtype == jnp.float32 for leaf in leaves)


@pytest.mark.parametrize("bad", [-0.1, 1.0, 2.0, float("nan")])
def test_a_half_width_that_could_turn_a_sign_is_refused(bad):
    with pytest.raises(ValueError, match=r"UniformUncertainty\.half_width must be"):
        UniformUncertainty(bad)


def test_an_unknown_name_is_refused_with_the_choices():
    with pytest.raises(ValueError, match="received 'mass'; choose from") as refusal:
        UniformUncertainty(0.2, ("drag", "mass"))
    assert "surge_mass" in str(refusal.value)
