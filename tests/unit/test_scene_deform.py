"""Deformed meshes carry their splats: closed forms of the deformations, and every kind of binding."""

import numpy as np
import pytest
import trimesh

from gsbridge.errors import InputError
from gsbridge.geometry import rotation_from_quat
from gsbridge.meshes import Mesh
from gsbridge.scene.deform import bend, bulge, deform, twist
from gsbridge.splats.binding import create_binding


def column() -> Mesh:
    """A box 2 cm wide and 10 cm high, subdivided, its foot at z = 0 and off the origin."""
    box = trimesh.creation.box((0.02, 0.02, 0.1)).subdivide().subdivide()
    return Mesh(np.asarray(box.vertices) + np.array([0.3, 0.1, 0.05]), np.asarray(box.faces, np.int64))


def test_bend_keeps_the_axis_length_and_leans_the_top():
    angle, height = 0.9, 0.1
    line = np.stack([np.zeros(400), np.zeros(400), np.linspace(0, height, 400)], axis=1)
    bent = bend(angle, heading=np.pi / 2)(line)
    assert np.linalg.norm(np.diff(bent, axis=0), axis=1).sum() == pytest.approx(height, rel=1e-5)
    radius = height / angle
    np.testing.assert_allclose(bent[-1], [0, radius * (1 - np.cos(angle)), radius * np.sin(angle)], atol=1e-12)
    np.testing.assert_allclose(bend(0.0)(line), line)


def test_twist_and_bulge_keep_the_foot():
    vertices = column().vertices
    foot = vertices[:, 2] < 1e-9
    for deformation in (twist(1.0), bulge(0.4)):
        np.testing.assert_allclose(deformation(vertices)[foot], vertices[foot], atol=1e-12)
    middle = vertices[:, :2].mean(0)
    radius = np.linalg.norm(vertices[:, :2] - middle, axis=1)
    turned = np.linalg.norm(twist(1.0)(vertices)[:, :2] - middle, axis=1)
    np.testing.assert_allclose(turned, radius, atol=1e-12)
    half = np.abs(vertices[:, 2] - 0.05) < 1e-9
    wide = np.linalg.norm(bulge(0.4)(vertices)[:, :2] - middle, axis=1)
    np.testing.assert_allclose(wide[half], 1.4 * radius[half], atol=1e-12)


@pytest.mark.parametrize("kind", ["games", "soft", "refined"])
def test_splats_follow_with_new_normals(kind):
    binding = create_binding(kind, column(), 2, band=0.01, seed=0)
    if kind == "soft":
        binding.parameters["offset"] += 0.2
    # A quarter turn about x as a deformation: everything must turn rigidly, offsets along the normals included.
    turn = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    rest, cloud = binding.evaluate(), deform(binding, lambda vertices: vertices @ turn.T)
    np.testing.assert_allclose(cloud.means, rest.means @ turn.T, atol=1e-6)
    np.testing.assert_allclose(cloud.scales, rest.scales, rtol=1e-3, atol=1e-7)
    expected = turn @ rotation_from_quat(rest.quats)
    found = rotation_from_quat(cloud.quats)
    np.testing.assert_allclose(np.abs(np.einsum("nij,nij->n", expected, found)), 3.0, atol=1e-4)
    # A real bend: discs stay in their faces' planes.
    bent = deform(binding, bend(0.8))
    corners = Mesh(bend(0.8)(binding.vertices), binding.faces).corners()[binding.face_index]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs((rotation_from_quat(bent.quats)[:, :, 0] * normals).sum(1)), 1.0, atol=1e-5)


def test_unbound_splats_and_bad_deformations_are_refused():
    with pytest.raises(InputError, match="unbound"):
        deform(create_binding("unbound", column(), 1, band=0.01, seed=0), bend(0.5))
    binding = create_binding("soft", column(), 1, band=0.01, seed=0)
    with pytest.raises(ValueError, match="finite"):
        deform(binding, lambda vertices: vertices * np.nan)
    with pytest.raises(ValueError, match="finite"):
        deform(binding, lambda vertices: vertices[1:])
    rest = binding.vertices.copy()
    deform(binding, lambda vertices: vertices.__imul__(2.0))
    np.testing.assert_array_equal(binding.vertices, rest)
