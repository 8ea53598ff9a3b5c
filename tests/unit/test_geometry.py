"""Rotations and similarities against scipy and closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gsbridge.geometry import (
    Similarity,
    align_similarity,
    fit_plane,
    quat_from_rotation,
    quat_multiply,
    rotation_angle,
    rotation_between,
    rotation_from_quat,
)

seeds = st.integers(0, 2**31 - 1)


@given(seeds)
def test_quaternions_agree_with_scipy(seed):
    rotations = Rotation.random(5, random_state=seed)
    expected = rotations.as_quat(scalar_first=True, canonical=True)
    np.testing.assert_allclose(quat_from_rotation(rotations.as_matrix()), expected, atol=1e-9)
    np.testing.assert_allclose(rotation_from_quat(expected), rotations.as_matrix(), atol=1e-12)


@given(seeds)
def test_quaternion_product_is_rotation_product(seed):
    a, b = Rotation.random(2, random_state=seed)
    product = quat_multiply(a.as_quat(scalar_first=True), b.as_quat(scalar_first=True))
    np.testing.assert_allclose(rotation_from_quat(product), (a * b).as_matrix(), atol=1e-12)


@given(st.floats(1e-9, np.pi - 1e-3))
def test_rotation_angle_keeps_small_angles(angle):
    assert rotation_angle(Rotation.from_rotvec([0, angle, 0]).as_matrix()) == pytest.approx(angle, rel=1e-6)


@pytest.mark.parametrize("target", [[0, 0, 1], [0, 0, -1], [1, 2, 3]])
def test_rotation_between_turns_source_into_target(target):
    rotation = rotation_between([0, 0, 1], target)
    np.testing.assert_allclose(rotation @ [0, 0, 1], np.array(target) / np.linalg.norm(target), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@given(seeds, st.floats(1e-3, 1e3))
def test_similarity_is_recovered_from_its_own_points(seed, scale):
    rng = np.random.default_rng(seed)
    truth = Similarity(scale, Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3))
    points = rng.normal(size=(6, 3))
    found = align_similarity(points, truth.apply(points))
    assert found.scale == pytest.approx(scale, rel=1e-9)
    np.testing.assert_allclose(found.apply(points), truth.apply(points), atol=1e-9 * scale + 1e-9)
    np.testing.assert_allclose(truth.inverse().apply(truth.apply(points)), points, atol=1e-8)
    np.testing.assert_allclose(Similarity.from_matrix(truth.matrix()).apply(points), truth.apply(points), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(truth.compose(truth).apply(points), truth.apply(truth.apply(points)), rtol=1e-7, atol=1e-6)


def test_moved_pose_sees_the_moved_point_at_the_same_pixel():
    rng = np.random.default_rng(3)
    move = Similarity(0.2, Rotation.random(random_state=1).as_matrix(), rng.normal(size=3))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=2).as_matrix()
    pose[:3, 3] = rng.normal(size=3)
    point = rng.normal(size=3)
    before = pose[:3, :3] @ point + pose[:3, 3]
    moved = move.move_pose(pose)
    after = moved[:3, :3] @ move.apply(point) + moved[:3, 3]
    np.testing.assert_allclose(after, 0.2 * before, atol=1e-12)


def test_alignment_refuses_what_does_not_determine_it():
    with pytest.raises(ValueError, match="three"):
        align_similarity(np.zeros((2, 3)), np.zeros((2, 3)))
    line = np.outer(np.arange(5.0), [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="line"):
        align_similarity(line, line)


def test_matrix_with_shear_is_no_similarity():
    shear = np.eye(4)
    shear[0, 1] = 0.1
    with pytest.raises(ValueError, match="similarity"):
        Similarity.from_matrix(shear)


def test_plane_through_points_of_a_known_plane():
    rng = np.random.default_rng(0)
    normal = np.array([1.0, 2.0, 2.0]) / 3.0
    basis = np.linalg.svd(normal[None])[2][1:]
    points = rng.normal(size=(50, 2)) @ basis + 0.7 * normal
    found, offset = fit_plane(points)
    sign = np.sign(found @ normal)
    np.testing.assert_allclose(sign * found, normal, atol=1e-12)
    assert sign * offset == pytest.approx(0.7)
