"""Rotations against SciPy's."""

import numpy as np
import pytest
from messages import refused
from scipy.spatial.transform import Rotation

from flockstep import rotations

RNG = np.random.default_rng(5)
QUATS = Rotation.random(2000, random_state=5).as_quat(scalar_first=True)
RPY = RNG.uniform([-np.pi, -np.pi / 2, -np.pi], [np.pi, np.pi / 2, np.pi], (2000, 3))


def of_rpy(rpy):
    return Rotation.from_euler("ZYX", np.asarray(rpy)[..., ::-1])


def angle_between(a, b):
    return (a.inv() * b).magnitude()


def test_vectors_turn_as_scipys():
    vectors = RNG.normal(size=(2000, 3))
    of = Rotation.from_quat(QUATS, scalar_first=True)
    np.testing.assert_allclose(rotations.rotate(QUATS, vectors), of.apply(vectors), atol=1e-12)
    np.testing.assert_allclose(rotations.rotate(QUATS, vectors, inverse=True), of.inv().apply(vectors), atol=1e-12)


def test_rpy_to_quat():
    quats = rotations.quat_from_rpy(RPY)
    assert angle_between(Rotation.from_quat(quats, scalar_first=True), of_rpy(RPY)).max() < 1e-12
    assert (quats[:, 0] >= 0).all()


def test_quat_to_rpy():
    rpy = rotations.rpy_from_quat(QUATS)
    expected = Rotation.from_quat(QUATS, scalar_first=True).as_euler("ZYX")[:, ::-1]
    np.testing.assert_allclose(rpy, expected, atol=1e-9)
    np.testing.assert_allclose(rotations.rpy_from_quat(-QUATS), expected, atol=1e-9)
    np.testing.assert_allclose(rotations.yaw_of(QUATS), expected[:, 2], atol=1e-9)


@pytest.mark.parametrize("pitch", [-np.pi / 2, np.pi / 2, np.pi / 2 - 1e-9, -np.pi / 2 + 1e-9])
def test_straight_up_or_down_is_the_same_rotation(pitch):
    rpy = np.stack([RNG.uniform(-3, 3, 500), np.full(500, pitch), RNG.uniform(-3, 3, 500)], axis=1)
    back = rotations.rpy_from_quat(rotations.quat_from_rpy(rpy))
    assert angle_between(of_rpy(back), of_rpy(rpy)).max() < 1e-7
    assert np.isfinite(back).all()


def test_shapes_and_types_are_kept():
    vectors = RNG.normal(size=(100, 3)).astype(np.float32)
    turned = rotations.rotate(np.tile(np.float32([1, 0, 0, 0]), (100, 1)), vectors)
    assert turned.dtype == np.float32
    np.testing.assert_array_equal(turned, vectors)  # the identity is exact
    assert rotations.quat_from_rpy([0, 0, np.pi]).shape == (4,)
    assert rotations.rpy_from_quat(QUATS.reshape(20, 100, 4).astype(np.float32)).shape == (20, 100, 3)
    assert rotations.rpy_from_quat(QUATS.astype(np.float32)).dtype == np.float32
    assert rotations.quat_from_rpy(np.zeros((5, 3), np.float32)).dtype == np.float32


def test_wrong_shapes_are_refused():
    with refused(ValueError, "quat_wxyz"):
        rotations.rpy_from_quat([1, 2, 3])
    with refused(ValueError, "rpy"):
        rotations.quat_from_rpy(1.0)
