"""Meshes of a ball whose shape is known from a formula."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from table_scene import CENTRE, RADIUS, ball_scene

from gsbridge.cameras import Views
from gsbridge.errors import InputError, StageError
from gsbridge.images import write_image
from gsbridge.mesh import MeshSettings, mesh_object
from gsbridge.mesh.backends import choose_backend, write_colmap_workspace
from gsbridge.mesh.depth import depth_cloud, rank_sources
from gsbridge.mesh.fuse import vertex_colours
from gsbridge.mesh.hull import build_hull, object_box, read_masks, silhouettes
from gsbridge.mesh.objects import azimuth_coverage
from gsbridge.mesh.repair import closed_surface, components, largest_part, signed_field
from gsbridge.meshes import Mesh, read_mesh
from gsbridge.photogrammetry.carving import Grid

SMALL = MeshSettings(backend="sweep", faces=3000, collision_faces=1500, hull_voxels=64, poisson_depth=6, solid_voxels=64)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return ball_scene(tmp_path_factory.getbasetemp() / "ball")


@pytest.fixture(scope="module")
def hull(scene):
    return build_hull(scene.views, read_masks(scene.views, scene.masks), vote=0.93, voxels=64, width=256, threads=1)


@pytest.fixture(scope="module")
def meshes(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("mesh")
    mesh_object(
        scene.views, scene.masks, scene.points_npz, folder / "visual.ply", folder / "collision.ply", folder / "mesh.json", SMALL
    )
    return folder


@pytest.mark.parametrize(("name", "faces"), [("visual", 3000), ("collision", 1500)])
def test_meshes_are_closed_within_budget_and_on_the_table(meshes, name, faces):
    mesh = trimesh.load(meshes / f"{name}.ply", process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert len(mesh.faces) <= faces
    assert mesh.body_count == 1
    assert 0 <= mesh.vertices[:, 2].min() < 0.001


def test_visual_mesh_is_the_ball(meshes):
    mesh = trimesh.load(meshes / "visual.ply", process=False)
    points = mesh.sample(5000, seed=0)
    points = points[points[:, 2] > 0.003]
    error = np.abs(np.linalg.norm(points - CENTRE, axis=1) - RADIUS)
    assert error.mean() < 0.0008
    assert np.percentile(error, 95) < 0.002
    height = CENTRE[2] + RADIUS
    assert mesh.volume == pytest.approx(np.pi * height**2 * (RADIUS - height / 3), rel=0.06)


def test_hull_holds_the_ball(meshes):
    mesh = trimesh.load(meshes / "collision.ply", process=False)
    radius = np.linalg.norm(mesh.vertices[mesh.vertices[:, 2] > 0.003] - CENTRE, axis=1)
    assert np.percentile(radius, 5) > RADIUS - 0.002
    assert np.median(radius) < RADIUS + 0.003


def test_record_and_colours(meshes):
    record = json.loads((meshes / "mesh.json").read_text())
    assert record["status"] == "pass"
    assert record["visual"]["watertight"]
    assert record["collision"]["watertight"]
    assert record["coverage_deg"] == 360
    assert record["backend"] == "sweep"
    assert record["confirmed_share"] > 0.5
    mesh = read_mesh(meshes / "visual.ply")
    assert record["visual"]["faces"] == len(mesh.faces)
    top = mesh.vertices[:, 2] > 0.02
    # The ball is red, the table grey.
    assert (mesh.colours[top, 0] > 1.5 * mesh.colours[top, 2]).mean() > 0.95


def test_confirmed_depth_lies_on_the_ball(scene, hull):
    masks = read_masks(scene.views, scene.masks)
    cloud = depth_cloud(scene.views, masks, hull, SMALL, seed=0, threads=1)
    again = depth_cloud(scene.views, masks, hull, SMALL, seed=0, threads=2)
    np.testing.assert_array_equal(cloud.points, again.points)
    error = np.abs(np.linalg.norm(cloud.points - CENTRE, axis=1) - RADIUS)
    assert len(cloud.points) > 1000
    assert np.median(error) < 0.0004
    assert np.percentile(error, 95) < 0.0015
    outward = ((cloud.points - CENTRE) / RADIUS * cloud.normals).sum(1)
    assert np.median(outward) > 0.97
    assert sum(item.sum() for item in cloud.confirmed) > 0.6 * cloud.tried


def test_views_of_one_side_degrade(scene, tmp_path):
    from gsbridge.cameras import Views

    side = Views(scene.views.images, tuple(view for view in scene.views if view.centre[0] > 0))
    out = [tmp_path / name for name in ("visual.ply", "collision.ply", "mesh.json")]
    mesh_object(side, scene.masks, scene.points_npz, *out, SMALL)
    record = json.loads(out[2].read_text())
    assert record["status"] == "degraded"
    assert "unseen side" in record["reasons"][0]
    assert trimesh.load(out[0]).is_watertight
    assert trimesh.load(out[1]).is_watertight


def test_box_of_the_masks_holds_the_ball(scene):
    low, high = object_box(silhouettes(scene.views, scene.inside, 256))
    assert (low <= np.maximum(CENTRE - RADIUS, 0)).all()
    assert (high >= CENTRE + RADIUS).all()
    assert (high - low).max() < 4 * RADIUS


def test_sources_look_from_nearby(scene):
    for index, chosen in enumerate(rank_sources(scene.views, CENTRE, 4)):
        rays = np.stack([CENTRE - view.centre for view in scene.views])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        assert index not in chosen
        assert len(set(chosen)) == len(chosen) >= 2
        assert (np.degrees(np.arccos(rays[chosen] @ rays[index])) < 60).all()


def test_coverage_counts_the_widest_gap(scene):
    assert azimuth_coverage(scene.views, CENTRE) == 360
    side = [view for view in scene.views if view.centre[0] > 0]
    assert 140 < azimuth_coverage(side, CENTRE) < 190


def test_signed_field_of_a_box():
    box = trimesh.creation.box(extents=[0.2, 0.1, 0.06])
    grid = Grid.covering([-0.15, -0.1, -0.08], [0.15, 0.1, 0.08], 0.005)
    field = signed_field(Mesh(box.vertices, np.asarray(box.faces)), grid).ravel()
    outside = np.abs(grid.points()[::37]) - np.array([0.1, 0.05, 0.03])
    true = -(np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(axis=1), 0))
    near = np.abs(true) < 0.02
    np.testing.assert_allclose(field[::37][near], true[near], atol=1e-5)
    assert (np.sign(field[::37]) == np.sign(true))[np.abs(true) > 1e-6].all()


def test_closed_surface_falls_back_to_a_mesh_that_is_always_closed(monkeypatch):
    from gsbridge.mesh import repair

    grid = Grid.covering([-0.06] * 3, [0.06] * 3, 0.002)
    field = (0.04 - np.linalg.norm(grid.points(), axis=1)).reshape(grid.shape).astype(np.float32)

    def broken(mesh, faces):
        return Mesh(mesh.vertices, mesh.faces[: faces // 2])

    monkeypatch.setattr(repair, "_isotropic", broken)
    monkeypatch.setattr(repair, "_decimated", broken)
    mesh = closed_surface(grid, field, 2000)
    assert mesh.trimesh().is_watertight
    assert len(mesh.faces) <= 2000
    assert closed_surface(grid, -np.ones(grid.shape, np.float32), 2000) is None


def test_largest_part_drops_the_others():
    big, small = trimesh.creation.icosphere(3), trimesh.creation.icosphere(2, radius=0.2)
    small.apply_translation([3, 0, 0])
    both = trimesh.util.concatenate([big, small])
    mesh = Mesh(np.asarray(both.vertices), np.asarray(both.faces))
    assert len(np.unique(components(mesh))) == 2
    part = largest_part(mesh)
    assert len(part.faces) == len(big.faces)
    assert part.trimesh().volume == pytest.approx(big.volume)


def test_colours_come_from_the_side_that_is_seen(scene):
    from gsbridge.images import read_image

    ball = trimesh.creation.icosphere(3, radius=RADIUS)
    mesh = Mesh(ball.vertices + CENTRE, np.asarray(ball.faces))
    colours = vertex_colours(mesh, scene.views, [read_image(scene.views.path(view)) for view in scene.views])
    from table_scene import photo

    true = photo(mesh.vertices[None], np.ones((1, len(mesh.vertices)), bool))[0]
    upper = mesh.vertices[:, 2] > 0.02
    assert np.abs(colours - true)[upper].mean() < 0.05


def _expect(kind, match, scene, tmp_path, masks=None, points=None, settings=SMALL):
    out = [tmp_path / name for name in ("visual.ply", "collision.ply", "mesh.json")]
    with pytest.raises(kind, match=match):
        mesh_object(scene.views, masks or scene.masks, points or scene.points_npz, *out, settings)
    assert not any(path.exists() for path in out)


def test_empty_missing_and_scattered_masks(scene, tmp_path):
    shape = scene.inside[0].shape
    for view in scene.views:
        write_image(tmp_path / "empty" / view.name, np.zeros(shape, np.float32))
    _expect(StageError, "0 masks show the object", scene, tmp_path, tmp_path / "empty")
    _expect(InputError, "mask is missing", scene, tmp_path, tmp_path / "none")
    for index, view in enumerate(scene.views):
        spot = np.zeros(shape, np.float32)
        spot[10 + 12 * index : 22 + 12 * index, 20 * index % 240 : 20 * index % 240 + 8] = 1
        write_image(tmp_path / "spots" / view.name, spot)
    _expect(StageError, "share no volume|no common place|only .* masks", scene, tmp_path, tmp_path / "spots")
    for view in scene.views:
        write_image(tmp_path / "small" / view.name, np.ones((10, 10), np.float32))
    _expect(StageError, "another size", scene, tmp_path, tmp_path / "small")


def test_damaged_points_and_unknown_backend(scene, tmp_path):
    (tmp_path / "points.npz").write_bytes(b"PK broken")
    _expect(InputError, r"points\.npz.*damaged", scene, tmp_path, points=tmp_path / "points.npz")
    _expect(InputError, "do not exist", scene, tmp_path, points=tmp_path / "none.npz")
    with pytest.raises(InputError, match="auto, sweep, pycolmap, openmvs"):
        MeshSettings(backend="magic")


def test_backends_that_are_not_there_say_so(monkeypatch):
    from gsbridge.mesh import backends

    monkeypatch.setattr(backends, "has_pycolmap_stereo", lambda: False)
    monkeypatch.setattr(backends.shutil, "which", lambda name: None)
    assert choose_backend("auto") == choose_backend("sweep") == "sweep"
    for name, match in (("pycolmap", "needs CUDA"), ("openmvs", "not on the PATH")):
        with pytest.raises(InputError, match=match):
            choose_backend(name)
    monkeypatch.setattr(backends.shutil, "which", lambda name: f"bin/{name}")
    assert choose_backend("auto") == choose_backend("openmvs") == "openmvs"


@pytest.mark.parametrize("called", ["{}", "IMG {}"])
def test_workspace_for_outside_programs_is_a_colmap_model(scene, tmp_path, called):
    import pycolmap

    points = CENTRE + RADIUS * np.array([[0, 0, 1.0], [0.6, 0, 0.8], [0, -0.6, 0.8]])
    masks = read_masks(scene.views, scene.masks)
    photos = Views(tmp_path, tuple(replace(view, name=called.format(view.name)) for view in scene.views))
    for view, photo in zip(scene.views, photos, strict=True):
        photos.path(photo).symlink_to(scene.views.path(view).absolute())
    write_colmap_workspace(photos, masks, tmp_path / "work", points)
    model = pycolmap.Reconstruction(tmp_path / "work" / "sparse")
    assert model.num_reg_images() == len(scene.views)
    assert model.num_points3D() == 3
    by_name = {image.name: image for image in model.images.values()}
    for name, view in zip(sorted(by_name), scene.views, strict=True):
        np.testing.assert_allclose(by_name[name].projection_center(), view.centre, atol=1e-9)
        assert (tmp_path / "work" / "images" / name).is_file()
    # pycolmap projects the points onto the observations that were written.
    assert model.compute_mean_reprojection_error() == pytest.approx(0.5) or model.compute_mean_reprojection_error() < 0.01
    model.update_point_3d_errors()
    assert model.compute_mean_reprojection_error() < 0.01
