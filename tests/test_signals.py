import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxglider.signals import (
    BodyAxes,
    Channels,
    Command,
    GliderState,
    Measurement,
    map_fields,
    output_rates,
    zeros,
)


def test_a_state_at_rest_is_zero_but_for_the_given_fields():
    state = GliderState.at_rest(depth=3.0, yaw_rate=-0.1)
    values = {f.name: float(getattr(state, f.name)) for f in dataclasses.fields(state)}
    assert len(values) == 12
    assert {k: v for k, v in values.items() if v} == {"depth": 3.0, "yaw_rate": -0.1}


def test_an_unknown_field_is_refused_by_name():
    with pytest.raises(ValueError, match="no field 'deepth'; choose from") as refusal:
        GliderState.at_rest(deepth=1.0)
    assert "'depth'" in str(refusal.value)


def test_a_state_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match=r"GliderState\.pitch must be finite"):
        GliderState.at_rest(pitch=float("nan"))


def test_numbers_become_strongly_typed_leaves():
    for leaf in jax.tree.leaves((GliderState.at_rest(north=1), Command(1, 2.0, 3))):
        assert leaf.dtype == jnp.float64
        assert not leaf.aval.weak_type


def test_velocity_lists_the_six_body_rates_in_order():
    state = GliderState(*range(12))
    assert [float(x) for x in state.velocity().fields()] == [6, 7, 8, 9, 10, 11]


def test_each_maps_field_by_field_and_keeps_the_first_type():
    a, b = Channels(1.0, 2.0, 3.0), Channels(10.0, 20.0, 30.0)
    got = map_fields(lambda x, y: y - x, a, b)
    assert type(got) is Channels
    assert [float(got.depth), float(got.pitch), float(got.heading)] == [9.0, 18.0, 27.0]


def test_body_axes_add_subtract_and_divide_axis_by_axis():
    a = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    b = np.array([6.0, 5.0, -4.0, 3.0, 2.0, 1.0])
    x, y = BodyAxes(*a), BodyAxes(*b)
    np.testing.assert_array_equal((x + y).fields(), a + b)
    np.testing.assert_array_equal((x - y).fields(), a - b)
    np.testing.assert_array_equal((x / y).fields(), a / b)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize(("kind", "size"), [(BodyAxes, 6), (Channels, 3), (Command, 3)])
def test_zeros_have_the_precision_of_their_model(kind, size, dtype):
    leaves = jax.tree.leaves(zeros(kind, jnp.ones((), dtype)))
    assert len(leaves) == size
    assert all(leaf.dtype == dtype and float(leaf) == 0.0 for leaf in leaves)


def test_output_rates_are_those_of_the_moving_body():
    rng = np.random.default_rng(6)
    angles, nu = rng.uniform(-1, 1, 3), rng.normal(size=6)
    state = GliderState(0, 0, 0, *angles, *nu)
    rates = output_rates(
        Measurement(state, state.attitude(), zeros(Command), zeros(BodyAxes))
    )
    rotation = Rotation.from_euler("ZYX", angles[::-1])
    np.testing.assert_allclose(rates.depth, rotation.apply(nu[:3])[2], rtol=1e-13)
    # Turn the body a little by its own rates and read the Euler angles again.
    h = 1e-5
    after, before = (
        (rotation * Rotation.from_rotvec(sign * h * nu[3:])).as_euler("ZYX")
        for sign in (1, -1)
    )
    heading, pitch, _ = (after - before) / (2 * h)
    np.testing.assert_allclose(rates.pitch, pitch, rtol=1e-8)
    np.testing.assert_allclose(rates.heading, heading, rtol=1e-8)
