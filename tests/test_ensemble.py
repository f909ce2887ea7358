import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
from jax import lax

from jaxglider.core import batching as ensemble
from jaxglider.core.batching import map_members, member_keys
from jaxglider.environment.disturbances import GaussMarkov
from jaxglider.signals import BodyAxes

COUNT = 13


def _member(given):
    """A driven oscillator with its own noise: a rollout in miniature."""
    key, stiffness = given
    law = GaussMarkov(BodyAxes(*(0.3,) * 6), BodyAxes(*(2.0,) * 6))
    force = law.realise(key, jnp.arange(40) * 0.1).surge

    def tick(state, push):
        place, speed = state
        speed = speed + 0.1 * (push - stiffness * jnp.sin(place) - 0.2 * speed)
        place = place + 0.1 * speed
        return (place, speed), place

    (place, speed), path = lax.scan(tick, (stiffness, -stiffness), force)
    return {"last": jnp.stack([place, speed]), "path": path, "positive": place > 0}


def _members(first=0, count=COUNT):
    stiffness = jnp.linspace(0.5, 2.0, COUNT)[first : first + count]
    return member_keys(7, count, first), stiffness


@pytest.fixture(scope="module")
def one_by_one():
    """The members by a plain loop."""
    single = jax.jit(_member)
    keys, stiffness = _members()
    rows = [single((keys[i], stiffness[i])) for i in range(COUNT)]
    return jax.tree.map(lambda *x: np.stack(x), *rows)


def _mapped(function, members, **options):
    """As one program: step by step, each slice and reshape would compile by itself."""
    return jax.jit(lambda x: map_members(function, x, **options))(members)


def _assert_same(got, wanted, exactly=False):
    assert jax.tree.structure(got) == jax.tree.structure(wanted)
    for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(wanted), strict=True):
        assert np.shape(a) == np.shape(b)
        if exactly or np.asarray(b).dtype == bool:
            np.testing.assert_array_equal(a, b)
        else:
            # The compiler rounds lanes and single numbers differently.
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-13)


@pytest.mark.parametrize("block", [1, 4, 13, 64])
def test_blocks_of_any_size_give_what_a_loop_over_members_gives(one_by_one, block):
    _assert_same(_mapped(_member, _members(), block=block), one_by_one)


@pytest.mark.parametrize("block", [2, 64])
def test_two_devices_give_what_one_gives(one_by_one, block):
    devices = jax.devices()[:2]
    assert len(devices) == 2
    got = _mapped(_member, _members(), block=block, devices=devices)
    _assert_same(got, one_by_one)
    used = {
        shard.device for x in jax.tree.leaves(got) for shard in x.addressable_shards
    }
    assert used == set(devices)


def test_a_list_of_one_device_spreads_nothing(one_by_one):
    got = _mapped(_member, _members(), block=5, devices=jax.devices()[:1])
    _assert_same(got, one_by_one)


def test_a_member_can_be_run_again_by_itself(one_by_one):
    alone = _mapped(_member, _members(first=9, count=1))
    _assert_same(alone, jax.tree.map(lambda x: x[9:10], one_by_one))


def test_members_keep_their_order_and_padding_is_dropped():
    for count, block in ((1, 4), (4, 4), (5, 4), (11, 3)):
        numbers = jnp.arange(count)
        for devices in (None, jax.devices()[:2]):
            got = _mapped(lambda i: 10 * i, numbers, block=block, devices=devices)
            np.testing.assert_array_equal(got, 10 * np.arange(count))


def test_padding_repeats_a_member_and_so_adds_no_trouble_of_its_own():
    # A lane of zeros would give 0/0 here.
    with jax.debug_nans(True):
        got = map_members(lambda x: x / x, jnp.arange(1.0, 6.0), block=4)
    np.testing.assert_array_equal(got, np.ones(5))


def test_a_function_is_traced_once_however_many_blocks_there_are():
    traces = []

    def count(x):
        traces.append(None)
        return x

    jax.make_jaxpr(lambda x: map_members(count, x, block=3))(jnp.arange(12.0))
    assert len(traces) == 1


def test_gradients_run_through_the_blocks():
    def total(scale):
        return map_members(lambda x: jnp.sin(scale * x), numbers, block=3).sum()

    numbers = jnp.linspace(0.1, 1.0, 7)
    wanted = np.sum(np.asarray(numbers) * np.cos(2.0 * np.asarray(numbers)))
    np.testing.assert_allclose(jax.grad(total)(2.0), wanted, rtol=1e-14)


def test_keys_depend_on_seed_and_number_alone():
    data = jr.key_data(member_keys(7, 10))
    np.testing.assert_array_equal(jr.key_data(member_keys(7, 3, first=4)), data[4:7])
    assert len({tuple(row) for row in np.asarray(data)}) == 10
    other = np.asarray(jr.key_data(member_keys(8, 10)))
    assert not {tuple(r) for r in other} & {tuple(r) for r in np.asarray(data)}
    wanted = jr.fold_in(jr.key(7), 6)
    np.testing.assert_array_equal(jr.key_data(wanted), data[6])


@pytest.mark.parametrize("members", [0, -3])
def test_fewer_than_one_member_is_refused(members):
    with pytest.raises(ValueError, match=f"at least 1; received {members}"):
        member_keys(0, members)


@pytest.mark.parametrize(
    "members",
    [
        (jnp.zeros(3), jnp.zeros(4)),
        (jnp.zeros(3), jnp.asarray(1.0)),
        jnp.asarray(1.0),
        (),
    ],
)
def test_members_without_one_common_leading_axis_are_refused(members):
    with pytest.raises(ValueError, match="one leading axis of the same length"):
        map_members(lambda x: x, members)


def test_an_empty_ensemble_is_refused():
    with pytest.raises(ValueError, match="members"):
        map_members(lambda x: x, jnp.zeros(0))


def test_a_block_below_one_is_refused():
    with pytest.raises(ValueError, match="block must be at least 1; received 0"):
        map_members(lambda x: x, jnp.zeros(3), block=0)


def test_the_default_block_is_used(monkeypatch):
    assert ensemble.BLOCK >= 8
    shapes = []

    def look(x):
        shapes.append(x.shape)
        return x

    # One more than fills three blocks: four, as even as can be.
    count = 3 * ensemble.BLOCK + 1
    jaxpr = jax.make_jaxpr(lambda x: map_members(look, x))(jnp.arange(float(count)))
    assert shapes == [()]
    assert f"f64[4,{-(-count // 4)}]" in str(jaxpr)
