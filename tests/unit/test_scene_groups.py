"""Groups of splats: the pictures of the whole composition, from less work."""

import numpy as np
import pytest
import torch
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from test_scene_editing import CAMERA, VIEW, make_cloud, make_pose

from gsbridge.cameras import Camera, look_at
from gsbridge.geometry import rotation_from_quat
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.scene.editing import Composition
from gsbridge.scene.groups import GroupedComposition
from gsbridge.scene.view import draw, draw_seen, pooled
from gsbridge.splats.cloud import Cloud
from gsbridge.splats.rasterize import rasterize
from gsbridge.splats.rasterize.layout import ALPHA_MIN, BLUR, GROUP

GREY = (0.5, 0.5, 0.5)
LARGE = GroupedComposition({"a": make_cloud(301, 1), "b": make_cloud(40, 2)}, make_cloud(500, 3))


def pictures(bodies, background, poses, camera, view):
    """Colour, alpha and depth of the whole composition and of the grouped one, and the groups drawn of all."""
    whole, grouped = Composition(bodies, background), GroupedComposition(bodies, background)
    whole.pose(poses)
    seen = grouped.see(poses, camera, view)
    drawn = draw_seen(grouped.splats, seen, camera, GREY, 1)
    return draw(whole.splats, camera, view, GREY, 1), drawn, (len(seen.groups), grouped.splats.count // GROUP)


def closest_depths(bodies, background, poses, view) -> float:
    """Least distance of the depths of two splats, in float64, m."""
    parts = [(background.means, np.eye(4)), *((bodies[name].means, pose) for name, pose in poses.items())]
    return np.diff(np.sort(np.concatenate([means @ (view @ pose)[2, :3] + (view @ pose)[2, 3] for means, pose in parts]))).min()


unit = st.floats(-1, 1, allow_nan=False)


@settings(max_examples=80, deadline=None)
@example(quat=(0.5, 0.0, -0.002, 0.0), translation=(-0.21260634195317196, 0.0, -0.04795329312447394),
         eye=(-0.21260634195317196, 0.055, 0.0), size=(64, 60.0))  # fmt: skip
@given(
    quat=st.tuples(*[unit] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    translation=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    eye=st.tuples(*[st.floats(-0.4, 0.4)] * 3).filter(lambda x: np.linalg.norm(x[:2]) > 0.02),
    size=st.sampled_from([(16, 40.0), (64, 60.0), (33, 500.0)]),
)
def test_what_the_view_leaves_out_changes_no_picture(quat, translation, eye, size):
    """Balls and margins are on the safe side: with any camera, near ones among them, only what is a matter of rounding differs,
    a splat at the cut-off. Views in which rounding settles the order of two splats are left out."""
    pixels, focal = size
    camera = Camera(pixels, pixels + 3, focal, 1.1 * focal, pixels / 2, pixels / 2 - 2)
    poses = {"a": make_pose(quat, translation), "b": make_pose((1, 0, 0, 0), (0.1, 0, 0))}
    bodies = {"a": make_cloud(301, 1), "b": make_cloud(40, 2)}
    background, view = make_cloud(500, 3), look_at(np.array(eye), np.zeros(3))
    # In single precision depths of some decimetres are equal below this; three views of ten have such a pair somewhere.
    assume(closest_depths(bodies, background, poses, view) > 1e-7)
    whole, drawn, _ = pictures(bodies, background, poses, camera, view)
    for expected, found in zip(whole, drawn, strict=True):
        # Which side of the rasteriser's cut-off, an opacity of 1/255, a splat is on at a pixel may change by rounding.
        np.testing.assert_allclose(found, expected, atol=ALPHA_MIN)
        apart = np.abs(found - expected).reshape(*expected.shape[:2], -1).max(axis=-1)
        assert np.count_nonzero(apart > 2e-3) <= 1


def test_only_what_is_near_the_view_is_drawn():
    """A narrow view of a wide table."""
    rng = np.random.default_rng(0)
    count = 8000
    means = np.concatenate([rng.uniform(-1, 1, (count, 2)), np.zeros((count, 1))], axis=1)
    table = Cloud(
        means, np.tile([1.0, 0, 0, 0], (count, 1)), np.full((count, 3), 0.005), np.full(count, 0.9), np.ones((count, 3))
    )
    camera = Camera(64, 64, 64.0, 64.0, 32.0, 32.0)
    _, _, (drawn, every) = pictures({}, table, {}, camera, look_at((0.0, -0.01, 0.3), (0.0, 0.0, 0.0)))
    assert 0 < drawn < 0.15 * every


def test_its_size_is_that_of_what_was_given():
    assert len(LARGE) == 841
    assert LARGE.splats.count % GROUP == 0
    assert len(GroupedComposition({})) == 0
    assert len(GroupedComposition({}).see({}, CAMERA, VIEW).groups) == 0


def test_bad_poses_and_clouds():
    with pytest.raises(KeyError):
        LARGE.see({"a": np.eye(4)}, CAMERA, VIEW)
    for bad in (np.nan * np.eye(4), np.diag([1.0, 1, -1, 1]), np.diag([1.0, 1, 1.1, 1])):
        with pytest.raises(ValueError, match="pose of b"):
            LARGE.see({"a": np.eye(4), "b": bad}, CAMERA, VIEW)

    class Harmonics:
        """Not plain colours."""

    with pytest.raises(TypeError, match="Harmonics"):
        GroupedComposition({"a": Harmonics()})


def share_of_light(cloud: Cloud, camera: Camera, view) -> np.ndarray:
    """What a splat's area on the screen is of its area after widening, in float64: root of the determinants' ratio. [N]."""
    x, y, z = (cloud.means.astype(float) @ view[:3, :3].T + view[:3, 3]).T
    zero = np.zeros_like(z)
    slope = [[camera.fx / z, zero, -camera.fx * x / z**2], [zero, camera.fy / z, -camera.fy * y / z**2]]
    quats = cloud.quats.astype(float) / np.linalg.norm(cloud.quats, axis=1, keepdims=True)
    axes = rotation_from_quat(quats) * cloud.scales.astype(float)[:, None, :]
    root = np.moveaxis(np.array(slope), -1, 0) @ view[:3, :3] @ axes
    covariance = root @ root.transpose(0, 2, 1)
    return np.sqrt(np.linalg.det(covariance) / np.linalg.det(covariance + BLUR * np.eye(2)))


def test_a_widened_splat_keeps_its_light():
    """Against plain torch, given opacities that were lowered in float64."""
    cloud = make_cloud(301, 1)
    camera = Camera(24, 20, 30.0, 33.0, 12.0, 10.0)
    grouped = GroupedComposition({"a": cloud})
    found = draw_seen(grouped.splats, grouped.see({"a": np.eye(4)}, camera, VIEW), camera, GREY, 1, antialiased=True)
    opacities = cloud.opacities * share_of_light(cloud, camera, VIEW)
    tensors = (
        torch.as_tensor(np.asarray(v, float)) for v in (cloud.means, cloud.quats, cloud.scales, opacities, cloud.colours)
    )
    expected = rasterize(
        *tensors, camera=camera, cam_from_table=VIEW, background=torch.tensor(GREY, dtype=torch.float64), backend="reference"
    )
    np.testing.assert_allclose(found[0], expected.colours, atol=2e-4)
    np.testing.assert_allclose(found[1], expected.alphas, atol=2e-4)


@given(st.integers(1, 4), st.integers(0, 2**31))
@settings(max_examples=20, deadline=None)
def test_a_pixel_is_the_mean_light_of_those_it_covers(factor, seed):
    rng = np.random.default_rng(seed)
    shape = 3 * factor, 2 * factor
    colours = rng.uniform(-0.1, 1.1, (*shape, 3)).astype(np.float32)
    alphas, depths = (rng.random(shape).astype(np.float32) for _ in range(2))
    found = pooled(colours, alphas, depths, factor)

    def mean(image):
        return image.astype(float).reshape(3, factor, 2, factor, *image.shape[2:]).mean((1, 3))

    np.testing.assert_allclose(found[0], srgb_from_linear(mean(linear_from_srgb(np.clip(colours, 0, 1)))), atol=5e-4)
    np.testing.assert_allclose(found[1], mean(alphas), atol=1e-6)
    np.testing.assert_allclose(found[2], mean(depths), atol=1e-6)
