"""The mirror's objects: closed, of real size, standing on the table, richly coloured."""

from __future__ import annotations

import numpy as np
import pytest

from gsbridge.errors import InputError
from gsbridge.libraries import import_open3d
from gsbridge.reality.mirror.objects import OBJECTS, make_object
from gsbridge.reality.mirror.path import OBJECT_SPOT_M
from gsbridge.reality.mirror.solids import box, mesh_of, rod, turned
from gsbridge.reality.mirror.studio import SCENES, placed
from gsbridge.reality.world.bodies import body_mesh, true_from_body

# Extent in x, y, z, mm, and volume, cm3: what the real thing measures.
SIZES = {
    "small_cube": ((58, 58, 58), (185, 197)),
    "cake": ((110, 110, 60), (420, 500)),
    "banana": ((180, 55, 38), (100, 150)),
    "bear": ((98, 90, 120), (300, 400)),
    "mug": ((115, 80, 92), (125, 150)),
    "bowl": ((138, 138, 55), (130, 160)),
    "pot": ((102, 102, 76), (105, 130)),
    "statue": ((90, 90, 120), (200, 240)),
    "toy": ((120, 66, 81), (160, 195)),
    "white_box": ((84, 56, 66), (300, 312)),
}
PLAIN = {"white_box"}


@pytest.fixture(scope="module", params=OBJECTS)
def made(request):
    return request.param, *make_object(request.param, 1, detail=3.0)


def test_closed_in_one_piece(made):
    _, mesh, _ = made
    assert mesh.is_watertight()
    assert mesh.trimesh().body_count == 1


def test_real_size_and_stands_on_the_table(made):
    name, mesh, _ = made
    extent, (least, most) = SIZES[name]
    assert np.allclose(np.ptp(mesh.vertices, axis=0) * 1e3, extent, atol=5)
    assert abs(mesh.vertices[:, 2].min()) < 1e-6
    assert least < mesh.volume() * 1e6 < most
    middle = (mesh.vertices.min(0) + mesh.vertices.max(0))[:2] / 2
    assert np.abs(middle).max() < 1e-9
    # A flat foot, not a point: some of the surface lies on the table.
    foot = mesh.areas()[(mesh.corners()[..., 2] < 1e-6).all(1)].sum()
    assert foot > 2e-4


def test_normals_point_outwards(made):
    _, mesh, normals = made
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    against = np.einsum("ij,ij->i", mesh.normals(), normals[mesh.faces[:, 0]])
    assert (against > 0).mean() > 0.99


def test_colours_are_reflectances_with_contrast(made):
    name, mesh, _ = made
    assert mesh.colours.shape == mesh.vertices.shape
    assert mesh.colours.min() > 0
    assert mesh.colours.max() < 0.8
    grey = mesh.colours.mean(1)
    assert (grey.std() / grey.mean() > 0.15) == (name not in PLAIN)


def test_texture_does_not_repeat_from_side_to_side():
    mesh, _ = make_object("small_cube", 1, detail=2.0)
    # Two opposite faces of the cube, sampled at the same places.
    left = mesh.vertices[:, 0] < -0.0289
    right = mesh.vertices[:, 0] > 0.0289
    from scipy.spatial import cKDTree

    match = cKDTree(mesh.vertices[right][:, 1:]).query(mesh.vertices[left][:, 1:])[1]
    a, b = mesh.colours[left].mean(1), mesh.colours[right][match].mean(1)
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.2


def test_meshing_matches_the_volume_of_a_cut_sphere():
    def ball(p):
        return np.linalg.norm(p - [0, 0, 10.0], axis=-1) - 20.0

    vertices, normals, faces = mesh_of(ball, (-20, -20, 0), (20, 20, 30), 0.9)
    tetrahedra = np.einsum("ij,ij->i", vertices[faces[:, 0]], np.cross(vertices[faces[:, 1]], vertices[faces[:, 2]])) / 6
    height = 30.0  # of the cap above z = 0
    assert tetrahedra.sum() * 1e9 == pytest.approx(np.pi * height**2 * (20 - height / 3), rel=5e-3)
    upper = vertices[:, 2] > 2e-3
    radial = (vertices - [0, 0, 0.01])[upper]
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", radial, normals[upper]).min() > 0.95


@pytest.mark.parametrize(("name", "thinnest", "thickest"), [("mug", 3.5, 8.0), ("bowl", 3.5, 12.0), ("pot", 3.5, 12.0)])
def test_walls_of_vessels_are_thin_and_closed(name, thinnest, thickest):
    """Rays from the axis outwards cross one wall, at all heights above the bottom; sloping walls and collars are thicker."""
    mesh, _ = make_object(name, 1, detail=2.0)
    open3d = import_open3d()
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    top = mesh.vertices[:, 2].max()
    middle = np.array([-0.017 if name == "mug" else 0.0, 0.0])  # the handle shifts the mug's footprint
    for height in np.linspace(0.3, 0.9, 5) * top:
        ray = np.array([[*middle, height, -0.6, 0.8, 0.0]], np.float32)
        radii = np.sort(scene.list_intersections(ray)["t_hit"].numpy()) * 1e3
        assert len(radii) == 2
        assert thinnest < radii[1] - radii[0] < thickest


def test_distances_to_shapes_are_those_of_their_nearest_points():
    rng = np.random.default_rng(0)
    p = rng.uniform(-40, 40, (500, 3))
    outside = np.maximum(np.abs(p - [1, 2, 3]) - [10, 20, 15], 0)
    far = np.linalg.norm(outside, axis=1)
    found = box(p, (1, 2, 3), (10, 20, 15))
    np.testing.assert_allclose(found[far > 0], far[far > 0], atol=1e-9)
    assert (found[far == 0] <= 0).all()
    line = np.linspace([0, 0, -10.0], [5, 0, 20.0], 4001)
    nearest = np.array([np.linalg.norm(line - q, axis=1).min() for q in p])
    np.testing.assert_allclose(rod(p, (0, 0, -10), (5, 0, 20), 3.0), nearest - 3.0, atol=2e-3)
    # A cylinder turned on the wheel is one: radius 12, from -5 to 25.
    q = np.stack([np.hypot(p[:, 0], p[:, 1]) - 12.0, np.abs(p[:, 2] - 10.0) - 15.0], axis=1)
    cylinder = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(1), 0)
    np.testing.assert_allclose(
        np.where(cylinder > 0, turned(p, [(0, -5), (12, -5), (12, 25), (0, 25)]), 0), np.maximum(cylinder, 0), atol=1e-9
    )
    assert (np.sign(turned(p, [(0, -5), (12, -5), (12, 25), (0, 25)])) == np.sign(cylinder)).mean() > 0.99


def test_unknown_object_is_refused():
    with pytest.raises(InputError, match="unknown"):
        make_object("teapot", 1)


def test_a_reconstruction_with_another_footprint_is_put_where_the_true_object_stands():
    """The step from its frame to the true one is the difference of the two footprints' middles."""
    mesh, normals = make_object("banana", 1, 2.0)
    filmed, _ = placed(mesh, normals, OBJECT_SPOT_M, SCENES["banana"][2])
    # A banana of which the last 6 mm at one end of its box were not seen.
    kept = filmed.vertices[:, 0] < filmed.vertices[:, 0].max() - 6e-3
    middle = 0.5 * (filmed.vertices[kept, :2].min(0) + filmed.vertices[kept, :2].max(0))
    body_from_table = np.eye(4)
    body_from_table[:2, 3] = -middle
    found = true_from_body("banana", 1, body_from_table)
    true_body, _ = body_mesh("banana", 1, 2.0)
    in_true = (filmed.vertices + body_from_table[:3, 3]) + found[:3, 3]
    np.testing.assert_allclose(in_true, true_body.vertices, atol=1e-9)
    assert found[0, 3] == pytest.approx(-3e-3, abs=3e-4)
