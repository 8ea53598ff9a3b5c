"""The Gaussian set: shapes, moving, joining."""

import numpy as np
import pytest

from gsbridge.geometry import Similarity, rotation_from_quat
from gsbridge.splats.cloud import Cloud, concatenate


def random_cloud(count: int, seed: int = 0) -> Cloud:
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(count, 4))
    return Cloud(
        rng.normal(size=(count, 3)),
        quats / np.linalg.norm(quats, axis=1, keepdims=True),
        rng.uniform(0.001, 0.01, (count, 3)),
        rng.uniform(0.05, 0.95, count),
        rng.uniform(0, 1, (count, 3)),
    )


def covariances(cloud: Cloud) -> np.ndarray:
    """R diag(s^2) R^T from scratch."""
    rotation = rotation_from_quat(cloud.quats)
    return np.einsum("nij,nj,nkj->nik", rotation, cloud.scales.astype(np.float64) ** 2, rotation)


def test_moving_a_cloud_moves_its_covariances():
    cloud = random_cloud(50)
    turn = rotation_from_quat(np.array([0.7, -0.2, 0.5, 0.1]))
    motion = Similarity(2.5, turn, np.array([0.1, -0.3, 0.7]))
    moved = cloud.transformed(motion)
    np.testing.assert_allclose(moved.means, cloud.means @ (2.5 * turn).T + motion.translation, atol=1e-5)
    linear = motion.matrix()[:3, :3]
    np.testing.assert_allclose(covariances(moved), linear @ covariances(cloud) @ linear.T, atol=2e-9)
    np.testing.assert_array_equal(moved.colours, cloud.colours)


def test_joining_keeps_order_and_selecting_undoes_it():
    first, second = random_cloud(4, 1), random_cloud(3, 2)
    joined = concatenate([first, second])
    assert len(joined) == 7
    np.testing.assert_array_equal(joined.subset(np.arange(4)).means, first.means)
    np.testing.assert_array_equal(joined.subset(np.arange(7) >= 4).opacities, second.opacities)
    low, high = joined.bounds()
    assert (low <= high).all()
    with pytest.raises(ValueError, match="no cloud"):
        concatenate([])


def test_a_wrong_shape_is_refused_by_name():
    with pytest.raises(ValueError, match="quats"):
        Cloud(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2), np.zeros((2, 3)))
