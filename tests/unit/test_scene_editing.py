"""Editing and views of splats: against float64 transforms, against rendering the moved clouds, and bad poses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gsbridge.cameras import Camera, look_at
from gsbridge.geometry import Similarity, rotation_from_quat
from gsbridge.scene.editing import Composition
from gsbridge.scene.view import render, shoot, to_bytes
from gsbridge.splats.cloud import Cloud, concatenate
from gsbridge.splats.rasterize import cpu

CAMERA = Camera(128, 128, 164.5, 164.5, 64.0, 64.0)
VIEW = look_at((0.0, -0.3, 0.35), (0.0, 0.0, 0.0))
PARTS = ("means", "quats", "scales", "opacities", "colours")


def make_cloud(count: int, seed: int) -> Cloud:
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(count, 4))
    return Cloud(
        rng.uniform(-0.05, 0.05, (count, 3)),
        quats / np.linalg.norm(quats, axis=1, keepdims=True),
        rng.uniform(0.001, 0.01, (count, 3)),
        rng.uniform(0.2, 0.99, count),
        rng.uniform(0, 1, (count, 3)),
    )


def make_pose(quat, translation) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = rotation_from_quat(np.asarray(quat, float))
    out[:3, 3] = translation
    return out


def assert_moved(composition: Composition, name: str, cloud: Cloud, pose: np.ndarray) -> None:
    """The arrays hold the cloud at the pose: means, and orientations up to the quaternion's sign."""
    part = composition.part(name)
    expected = cloud.transformed(Similarity.from_matrix(pose))
    np.testing.assert_allclose(composition.splats.means[part], expected.means, atol=3e-7)
    cosine = np.abs((composition.splats.quats[part] * expected.quats).sum(1))
    np.testing.assert_allclose(cosine, 1.0, atol=1e-6)


coordinates = st.floats(-2, 2, allow_nan=False)


@settings(max_examples=60, deadline=None)
@given(
    quat=st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    translation=st.tuples(coordinates, coordinates, coordinates),
)
def test_bodies_follow_any_pose(quat, translation):
    cloud = make_cloud(21, 0)
    composition = Composition({"body": cloud})
    pose = make_pose(quat, translation)
    composition.pose({"body": pose})
    assert_moved(composition, "body", cloud, pose)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle", [0.0, np.pi / 2, np.pi - 1e-5, np.pi, -2.0])
def test_every_way_to_a_quaternion(axis, angle):
    cloud = make_cloud(9, 1)
    composition = Composition({"body": cloud})
    quat = np.zeros(4)
    quat[0], quat[1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
    composition.pose({"body": make_pose(quat, (0.1, 0, 0))})
    assert_moved(composition, "body", cloud, make_pose(quat, (0.1, 0, 0)))


def test_only_moved_bodies_are_written_and_the_rest_stays():
    table, cloud, other = make_cloud(37, 2), make_cloud(20, 3), make_cloud(11, 4)
    composition = Composition({"a": cloud, "b": other}, table)
    first, second = make_pose((1, 1, 0, 0), (0.1, 0, 0)), make_pose((1, 0, 0, 1), (0, 0.2, 0))
    splats = composition.pose({"a": first})
    splats.means[composition.part("a")] = 7.0  # would be mended if the body were written again
    assert composition.pose({"a": first.copy(), "b": second}) is splats
    assert (splats.means[composition.part("a")] == 7.0).all()
    assert_moved(composition, "b", other, second)
    np.testing.assert_array_equal(splats.means[: len(table)], table.means)
    np.testing.assert_array_equal(composition.world_from_body("a"), first)
    # Back and forth many times leaves no drift, as each pose starts from the rest splats.
    for step in range(50):
        composition.pose({"b": make_pose((1, 0.1 * step, 0.3, 0), (0, 0, 0.01 * step))})
    composition.pose({"a": np.eye(4), "b": np.eye(4)})
    np.testing.assert_array_equal(splats.means[composition.part("a")], cloud.means)
    np.testing.assert_array_equal(splats.quats[composition.part("b")], other.quats)


def test_render_equals_the_moved_clouds():
    table, cloud, other = make_cloud(37, 2), make_cloud(20, 3), make_cloud(11, 4)
    poses = {"a": make_pose((1, 1, 0, 0), (0.05, 0, 0)), "b": make_pose((1, 0, 0.5, 1), (0, 0.06, 0))}
    composition = Composition({"a": cloud, "b": other}, table)
    composition.pose(poses)
    joined = concatenate([table, *(c.transformed(Similarity.from_matrix(poses[n])) for n, c in (("a", cloud), ("b", other)))])
    colours, alphas, _ = cpu.render(
        *(getattr(joined, part) for part in PARTS), camera=CAMERA, cam_from_table=VIEW, background=np.array([0.1, 0.2, 0.3])
    )
    shot = shoot(composition, CAMERA, VIEW, (0.1, 0.2, 0.3))
    np.testing.assert_allclose(shot.alphas, alphas, atol=2e-3)
    assert np.abs(shot.pixels.astype(int) - to_bytes(colours).astype(int)).max() <= 1
    np.testing.assert_array_equal(render(composition, CAMERA, VIEW, (0.1, 0.2, 0.3)), shot.pixels)
    assert shot.coverage == pytest.approx(float(alphas.mean()), abs=1e-4)
    assert render(composition, CAMERA.scaled(0.5), VIEW).shape == (64, 64, 3)


def test_arrays_are_whole_vectors_and_the_filling_is_invisible():
    composition = Composition({"a": make_cloud(3, 5)}, make_cloud(10, 6))
    assert len(composition) == 13
    assert len(composition.splats) == 16
    assert (composition.splats.opacities[13:] == 0).all()
    assert len(Composition({})) == 0
    assert render(Composition({}), CAMERA, VIEW, (1.0, 0.0, 0.5))[5, 5].tolist() == [255, 0, 128]


def test_reshaped_body_stays_at_its_pose():
    cloud, deformed = make_cloud(20, 7), make_cloud(20, 8)
    composition = Composition({"a": cloud}, make_cloud(5, 9))
    pose = make_pose((1, 0.2, 0, 0), (0, 0, 0.1))
    composition.pose({"a": pose})
    composition.reshape("a", deformed)
    assert_moved(composition, "a", deformed, pose)
    np.testing.assert_array_equal(composition.splats.scales[composition.part("a")], deformed.scales)
    with pytest.raises(ValueError, match="20 splats"):
        composition.reshape("a", make_cloud(19, 8))


@pytest.mark.parametrize(
    "bad",
    [
        np.diag([1.1, 1.1, 1.1, 1.0]),
        np.diag([-1.0, 1.0, 1.0, 1.0]),
        np.full((4, 4), np.nan),
        np.array([[1, 0.1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]),
        np.array([[1, 0, 0, np.inf], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]),
    ],
)
def test_poses_that_are_not_rigid_move_nothing(bad):
    composition = Composition({"a": make_cloud(20, 7), "b": make_cloud(4, 8)})
    before = composition.splats.means.copy()
    with pytest.raises(ValueError, match="pose of b"):
        composition.pose({"a": make_pose((1, 1, 0, 0), (0, 0, 0)), "b": bad})
    np.testing.assert_array_equal(composition.splats.means, before)
    np.testing.assert_array_equal(composition.world_from_body("a"), np.eye(4))


def test_unknown_bodies_and_other_splats_are_refused():
    composition = Composition({"a": make_cloud(4, 7)})
    with pytest.raises(KeyError, match="no body 'b'"):
        composition.pose({"b": np.eye(4)})

    class Harmonics:
        """Splats of another program."""

    with pytest.raises(TypeError, match="takes clouds"):
        Composition({"a": Harmonics()})
    with pytest.raises(ValueError, match="distortion"):
        render(composition, Camera(8, 8, 8, 8, 4, 4, (0.1, 0, 0, 0)), VIEW)


def test_bytes_are_clamped_not_wrapped():
    image = np.array([[[-0.5, 0.0, 0.5]], [[1.0, 1.004, 7.0]], [[np.nan, np.inf, -np.inf]]], np.float32)
    assert to_bytes(image).tolist() == [[[0, 0, 128]], [[255, 255, 255]], [[0, 255, 0]]]
