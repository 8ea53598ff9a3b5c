"""Height fields of a flat table and of a table with a block, drawn from formulas."""

import json

import numpy as np
import pytest
import trimesh
from table_scene import cameras, photo, trace

from gsbridge.cameras import Camera, View, Views
from gsbridge.errors import InputError, StageError
from gsbridge.images import write_image
from gsbridge.mesh import MeshSettings, mesh_background
from gsbridge.mesh.background import slab, table_mesh
from gsbridge.mesh.region import TableMap
from gsbridge.mesh.relief import smooth_heights

SMALL = MeshSettings(background_faces=3000, collision_faces=1500, table_size=(0.24, 0.2))
CAMERA = Camera(200, 150, 210.0, 210.0, 100.0, 75.0)


def film(folder, block):
    views = cameras(12, CAMERA)
    for view in views:
        points, _, on = trace(view, ball=False, block=block)
        write_image(folder / "images" / view.name, photo(points, np.zeros_like(on)))
    np.savez(folder / "points.npz", points=np.zeros((5, 3)), view_index=np.zeros(0, int), point_index=np.zeros(0, int))
    return Views(folder / "images", tuple(views)), folder / "points.npz"


@pytest.fixture(scope="module", params=[False, True], ids=["flat", "block"])
def background(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("background")
    views, points = film(folder, request.param)
    mesh_background(views, points, folder / "visual.ply", folder / "collision.ply", folder / "mesh.json", SMALL)
    record = json.loads((folder / "mesh.json").read_text())
    meshes = {name: trimesh.load(folder / f"{name}.ply", process=False) for name in ("visual", "collision")}
    return request.param, meshes, record


def test_heights(background):
    block, meshes, record = background
    x, y, z = meshes["visual"].vertices.T
    reach = np.maximum(np.abs(x), np.abs(y))
    # Patches of some mm blur the edge, so the rim is left out.
    assert np.abs(z[reach > 0.042]).max() == 0
    if block:
        assert record["method"] == "height field"
        assert np.percentile(np.abs(z[reach < 0.022] - 0.02), 95) < 0.002
    else:
        assert record["method"] == "plane"
        assert np.abs(z).max() == 0


def test_open_mesh_looks_up_and_covers_the_table(background):
    _, meshes, record = background
    mesh = meshes["visual"]
    assert (mesh.face_normals[:, 2] > 0).all()
    assert not mesh.is_watertight
    assert mesh.body_count == 1
    assert len(mesh.faces) <= 3000
    assert np.ptp(mesh.vertices[:, 0]) > 0.2
    assert np.ptp(mesh.vertices[:, 1]) > 0.17
    assert record["coverage"]["area"] == pytest.approx(trimesh.Trimesh(
        np.c_[mesh.vertices[:, :2], np.zeros(len(mesh.vertices))], mesh.faces, process=False).area, rel=0.12)  # fmt: skip


def test_slab_is_closed_below_the_table(background):
    block, meshes, _ = background
    mesh = meshes["collision"]
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert len(mesh.faces) <= 1500
    assert mesh.vertices[:, 2].min() < -0.005
    assert mesh.vertices[:, 2].max() == pytest.approx(0.02 if block else 0.0, abs=0.003)


def test_heights_fill_plain_areas_and_keep_edges():
    heights = 0.001 * np.arange(12)
    true = np.zeros((30, 40))
    true[:, 20:] = 8
    cost = np.abs(np.arange(12) - true[..., None]) > 0.5
    cost = cost.astype(np.float32)
    cost[10:20, 5:12] = 0.0
    cost[12:18, 26:33] = 0.0
    found, _ = smooth_heights(cost, np.ones((30, 40), bool), heights, slope=0.12, limit=1.2)
    np.testing.assert_allclose(found, 0.001 * true, atol=6e-4)


def test_slab_of_a_ragged_region_stays_closed():
    rng = np.random.default_rng(0)
    filmed = np.zeros((60, 70), bool)
    filmed[5:55, 5:65] = True
    for row, column in rng.integers(5, 55, (12, 2)):
        filmed[row : row + 6, column : column + 5] = False
    axis = 0.004 * np.arange(70)
    table = TableMap(axis, axis[:60], filmed, np.zeros(filmed.shape))
    mesh = slab(table, 0.02, 100000)
    reference = mesh.trimesh()
    assert mesh.is_watertight()
    assert reference.is_watertight
    assert reference.volume > 0
    with pytest.raises(StageError, match="too small"):
        slab(TableMap(axis, axis[:60], np.zeros_like(filmed), np.zeros(filmed.shape)), 0.02, 1000)
    with pytest.raises(StageError, match="too small"):
        table_mesh(TableMap(axis, axis[:60], np.zeros_like(filmed), np.zeros(filmed.shape)), 1000)


def test_views_that_do_not_see_the_table(tmp_path):
    views, points = film(tmp_path, False)
    out = [tmp_path / name for name in ("visual.ply", "collision.ply", "mesh.json")]
    up = []
    for view in views:
        pose = np.diag([1.0, -1.0, -1.0, 1.0]) @ view.cam_from_table
        up.append(View(view.name, view.camera, pose))
    with pytest.raises(StageError, match="looks down at the table"):
        mesh_background(Views(views.images, tuple(up)), points, *out, SMALL)
    with pytest.raises(StageError, match="seen by 40 photos"):
        mesh_background(views, points, *out, MeshSettings(min_views=40))
    with pytest.raises(InputError, match="do not exist"):
        mesh_background(views, tmp_path / "none.npz", *out, SMALL)
    assert not any(path.exists() for path in out)
