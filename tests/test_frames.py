import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import rotation_matrix
from scipy.spatial.transform import Rotation

from jaxglider.core import rotations as frames


@jax.jit
def _matrices(angles):
    def one(angles):
        a = frames.attitude(*angles)
        euler = [frames.euler_rates(a, *axis) for axis in jnp.eye(3)]
        return rotation_matrix(*angles), jnp.array(euler).T

    return jax.vmap(one)(angles)


def _random_angles(count=200):
    rng = np.random.default_rng(3)
    limits = np.array([np.pi, 1.4, 10.0])
    return rng.uniform(-limits, limits, (count, 3))


def test_rotation_and_euler_rate_matrices_are_fossens():
    rotation, euler = _matrices(jnp.array([[0.1, -0.4, 0.8]]))
    np.testing.assert_allclose(
        rotation[0],
        [
            [0.64170937, -0.74085814, -0.19833884],
            [0.66072871, 0.66533745, -0.34751064],
            [0.38941834, 0.09195267, 0.91645953],
        ],
        atol=5e-9,
    )
    np.testing.assert_allclose(
        euler[0],
        [
            [1.0, -0.04220889, -0.42068101],
            [0.0, 0.99500417, -0.09983342],
            [0.0, 0.10838958, 1.08028043],
        ],
        atol=5e-9,
    )


def test_rotation_is_orthogonal_and_right_handed():
    rotation, _ = _matrices(_random_angles())
    product = np.einsum("nij,nkj->nik", rotation, rotation)
    np.testing.assert_allclose(product, np.tile(np.eye(3), (200, 1, 1)), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=2e-15)


def test_rotation_agrees_with_scipy():
    angles = _random_angles()
    wanted = Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix()
    np.testing.assert_allclose(_matrices(angles)[0], wanted, atol=2e-15)


def test_body_to_ned_turns_a_vector_as_the_matrix_does():
    angles = _random_angles()
    vectors = np.random.default_rng(4).normal(size=(200, 3))

    def one(angles, vector):
        return frames.body_to_ned(frames.attitude(*angles), *vector)

    got = np.stack(jax.jit(jax.vmap(one))(angles, vectors), -1)
    turned = Rotation.from_euler("ZYX", angles[:, ::-1]).apply(vectors)
    np.testing.assert_allclose(got, turned, atol=5e-15)


def test_euler_rates_are_those_at_which_the_rotation_turns():
    angles, rates = _random_angles(), np.random.default_rng(5).normal(size=(200, 3))

    def one(angles, rates):
        euler = jnp.stack(frames.euler_rates(frames.attitude(*angles), *rates))
        return jax.jvp(lambda a: rotation_matrix(*a), (angles,), (euler,))

    rotation, turning = jax.jit(jax.vmap(one))(angles, rates)
    p, q, r = rates.T
    zero = np.zeros_like(p)
    skew = np.array([[zero, -r, q], [r, zero, -p], [-q, p, zero]]).transpose(2, 0, 1)
    np.testing.assert_allclose(turning, rotation @ skew, atol=5e-14)


@pytest.mark.parametrize(
    ("angle", "wanted"),
    [
        (4.0, -2.2831853071795862),
        (-4.0, 2.2831853071795862),
        (0.3, 0.3),
        (np.pi, -np.pi),
        (-np.pi, -np.pi),
        (7 * np.pi / 2, -np.pi / 2),
        (100.0, 100.0 - 32 * np.pi),
    ],
)
def test_wrap_returns_the_same_angle_between_minus_pi_and_pi(angle, wanted):
    got = frames.wrap(jnp.asarray(angle))
    np.testing.assert_allclose(got, wanted, atol=3e-14)
    assert float(jax.grad(frames.wrap)(jnp.asarray(angle))) == 1.0


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_frames_keep_the_precision_of_their_arguments(dtype):
    angles = [jnp.asarray(x, dtype) for x in (0.1, -0.4, 0.8)]
    assert rotation_matrix(*angles).dtype == dtype
    assert frames.wrap(angles[0]).dtype == dtype
