"""The mesh renderer: depth against an independent rasteriser and closed forms, colour, cutting, smoothing, light."""

import numpy as np
import pytest
import trimesh

from gsbridge.cameras import Camera, look_at
from gsbridge.images import linear_from_srgb
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.carving import mesh_depth
from gsbridge.scene.meshes import NEAR, Light, MeshComposition, mean_colour, uniform

CAMERA = Camera(96, 80, 110.0, 112.0, 47.3, 41.1)
QUAD = np.array([[0, 1, 2], [0, 2, 3]])


def ball() -> Mesh:
    shape = trimesh.creation.icosphere(3, 0.05)
    return uniform(Mesh(np.asarray(shape.vertices), np.asarray(shape.faces, np.int64)), (0.8, 0.4, 0.2))


def table(size: float = 0.5, colour=(0.2, 0.5, 0.7)) -> Mesh:
    corners = size * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    return uniform(Mesh(corners, QUAD), colour)


def test_depth_equals_the_other_rasteriser():
    view = look_at((0.1, -0.3, 0.2), (0, 0, 0.02))
    moved = np.eye(4)
    moved[:3, 3] = (0.02, 0.03, 0.05)
    composition = MeshComposition({"ball": ball()}, table(0.2))
    composition.pose({"ball": moved})
    joined = np.concatenate([table(0.2).vertices, ball().vertices + moved[:3, 3]])
    expected = mesh_depth(joined, np.concatenate([QUAD, ball().faces + 4]), CAMERA, view)
    found = composition.depth(CAMERA, view)
    seen = np.isfinite(expected)
    assert (np.isfinite(found) == seen).mean() > 0.9995  # pixels on an edge may go either way
    both = seen & np.isfinite(found)
    assert np.quantile(np.abs(found[both] - expected[both]), 0.999) < 1e-5


def test_triangles_that_reach_behind_the_camera_are_cut_not_dropped():
    """A table of two triangles below a camera that stands over it: half of each lies behind."""
    view = look_at((0.0, 0.0, 0.1), (0.0, 1.0, 0.0))
    depth = MeshComposition({}, table(4.0)).depth(CAMERA, view)
    rays = CAMERA.pixel_rays() @ view[:3, :3]
    expected = np.where(rays[..., 2] < 0, -0.1 / np.minimum(rays[..., 2], -1e-9), np.inf)
    reached = expected < 3.0
    assert reached.sum() > 2000
    np.testing.assert_allclose(depth[reached], expected[reached], rtol=1e-4)
    # Close to the plane z = NEAR of the camera itself.
    wall = Mesh(np.array([[-1.0, -1, NEAR * 0.5], [1, -1, NEAR * 0.5], [1, 1, 2.0], [-1, 1, 2.0]]), QUAD, np.ones((4, 3)))
    depth = MeshComposition({}, wall).depth(CAMERA, np.eye(4))
    assert np.isfinite(depth).any()
    assert depth.min() >= NEAR * 0.999


def test_colours_are_interpolated_in_perspective():
    colours = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]], np.float32)
    mesh = Mesh(table(0.3).vertices, QUAD, colours)
    view = look_at((0.05, -0.4, 0.2), (0, 0, 0))
    image = MeshComposition({}, mesh).render(CAMERA, view, samples=1)
    rays = CAMERA.pixel_rays() @ view[:3, :3]
    eye = -view[:3, :3].T @ view[:3, 3]
    hits = eye - rays * (eye[2] / rays[..., 2:])
    inside = (np.abs(hits[..., :2]) < 0.299).all(-1) & (rays[..., 2] < 0)
    expected = (hits[..., :2] + 0.3) / 0.6 * 255
    assert inside.sum() > 1500
    assert np.abs(image[inside][:, :2] - expected[inside]).max() <= 1.0


def test_samples_smooth_edges_and_agree_on_the_mean():
    view = look_at((0.1, -0.3, 0.2), (0, 0, 0))
    composition = MeshComposition({"ball": uniform(ball(), (1, 1, 1))})
    one, four = composition.render(CAMERA, view, samples=1), composition.render(CAMERA, view)
    assert set(np.unique(one)) == {0, 255}
    assert set(np.unique(four)) == {0, 64, 128, 191, 255}
    assert four.mean() == pytest.approx(one.mean(), rel=0.02)
    coverage = composition.coverage(CAMERA, view)
    np.testing.assert_allclose(coverage, four[..., 0] / 255, atol=0.003)
    backdrop = composition.render(CAMERA, view, (0.0, 0.5, 1.0))
    assert backdrop[0, 0].tolist() == [0, 128, 255]


def test_light_shades_by_the_normal():
    view = look_at((0.0, -0.3, 0.3), (0, 0, 0))
    composition = MeshComposition({}, table(0.05, (0.8, 0.8, 0.8)))
    centre = (slice(38, 44), slice(44, 50))
    for direction, ambient in (((0, 0, 1), 0.5), ((1, 0, 1), 0.3), ((0, 0, -1), 0.4)):
        image = composition.render(CAMERA, view, light=Light(direction, ambient))
        cosine = max(np.array(direction)[2] / np.linalg.norm(direction), 0.0)
        assert image[centre].mean() == pytest.approx(255 * 0.8 * (ambient + (1 - ambient) * cosine), abs=1.0)
    assert composition.render(CAMERA, view)[centre].mean() == pytest.approx(204, abs=1.0)


def test_bad_use_is_refused():
    with pytest.raises(ValueError, match="needs colours"):
        MeshComposition({"a": Mesh(table().vertices, QUAD)})
    with pytest.raises(KeyError, match="no body 'b'"):
        MeshComposition({"a": table()}).pose({"b": np.eye(4)})
    with pytest.raises(ValueError, match="distortion"):
        MeshComposition({"a": table()}).render(Camera(8, 8, 8, 8, 4, 4, (0.1, 0, 0, 0)), np.eye(4))
    assert MeshComposition({}).render(CAMERA, np.eye(4)).max() == 0


def test_mean_colour_averages_light_inside_the_mask():
    image = np.zeros((4, 4, 3))
    image[:2] = 1.0
    mask = np.zeros((4, 4))
    mask[1:3] = 1.0
    assert linear_from_srgb(mean_colour([image], [mask])) == pytest.approx(np.full(3, 0.5))
    with pytest.raises(ValueError, match="no pixel"):
        mean_colour([image], [np.zeros((4, 4))])
