"""Deformed meshes carry their splats: closed forms of the deformations, and every kind of binding."""

import numpy as np
import pytest
import trimesh
from doc_blocks import ROOT, blocks

from gsbridge.errors import InputError
from gsbridge.geometry import rotation_from_quat
from gsbridge.meshes import Mesh
from gsbridge.scene.deform import bend, bulge, deform, pull, sequence, shift_only, twist
from gsbridge.scene.editing import Composition
from gsbridge.splats.binding import create_binding, read_binding, write_binding
from gsbridge.splats.ply import read_ply


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


def test_below_its_range_a_deformation_does_nothing_and_above_it_is_rigid():
    vertices, foot = column().vertices, np.array([0.3, 0.1, 0.0])
    share = vertices[:, 2] / 0.1
    below, above = share <= 0.5 + 1e-9, share >= 0.75 - 1e-9
    assert below.sum() > 20
    assert above.sum() > 20
    angle = 0.8
    # Where the straight top begins after an arc of 25 mm, towards +x.
    radius = 0.025 / angle
    arc = foot + np.array([radius * (1 - np.cos(angle)), 0, 0.05 + radius * np.sin(angle)])
    lean = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    base = foot + np.array([0, 0, 0.075])
    for deformation, expected in (
        (bend(angle, low=0.5, high=0.75), (vertices - base) @ lean.T + arc),
        (twist(angle, low=0.5, high=0.75), (vertices - foot) @ turn.T + foot),
    ):
        moved = deformation(vertices)
        np.testing.assert_allclose(moved[below], vertices[below], atol=1e-12)
        np.testing.assert_allclose(moved[above], expected[above], atol=1e-12)
    for make in (bend, twist):
        with pytest.raises(ValueError, match="range of heights"):
            make(0.5, low=0.6, high=0.6)


def test_a_pull_moves_the_farthest_point_and_leaves_the_rest():
    vertices = column().vertices
    direction = np.array([1.0, 0.5, 2.0])
    moved = pull(direction, 0.2, 0.4)(vertices) - vertices
    handle = vertices[np.argmax(vertices @ direction)]
    away = np.linalg.norm(vertices - handle, axis=1)
    np.testing.assert_allclose(moved[np.argmin(away)], 0.02 * direction / np.linalg.norm(direction), atol=1e-12)
    assert not moved[away >= 0.04].any()
    order = np.argsort(away)
    assert (np.diff(np.linalg.norm(moved, axis=1)[order]) <= 1e-12).all()
    for wrong in ((np.zeros(3), 0.1, 0.1), (direction, 0.1, 0.0)):
        with pytest.raises(ValueError, match="a pull needs"):
            pull(*wrong)


def test_a_sequence_applies_the_first_deformation_first():
    vertices = column().vertices
    both = sequence(twist(0.7), bend(0.4))(vertices)
    np.testing.assert_array_equal(both, bend(0.4)(twist(0.7)(vertices)))
    assert np.abs(both - twist(0.7)(bend(0.4)(vertices))).max() > 1e-3


@pytest.mark.parametrize("kind", ["games", "soft", "refined"])
def test_no_deformation_gives_the_rest_cloud(kind):
    binding = create_binding(kind, column(), 2, band=0.01, seed=0)
    rest = binding.evaluate()
    for nothing in (bend(0.0), twist(0.0), bulge(0.0), pull(np.array([0, 0, 1.0]), 0.0, 0.5)):
        cloud = deform(binding, nothing)
        np.testing.assert_allclose(cloud.means, rest.means, atol=1e-7)
        # Splats of one mesh are compared: the sign of a quaternion follows from its face and is the same.
        np.testing.assert_allclose(cloud.quats, rest.quats, atol=1e-5)
        np.testing.assert_allclose(cloud.scales, rest.scales, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("kind", ["games", "soft", "refined"])
def test_a_rigid_deformation_is_rigid_editing(kind):
    binding = create_binding(kind, column(), 2, band=0.01, seed=0)
    if kind != "games":
        binding.parameters["offset"] -= 0.3
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_quat(np.array([[0.7, -0.3, 0.5, 0.4]]) / np.linalg.norm([0.7, -0.3, 0.5, 0.4]))[0]
    pose[:3, 3] = [0.1, -0.2, 0.05]
    composition = Composition({"body": binding.evaluate()})
    composition.pose({"body": pose})
    edited = composition.splats.cloud()
    cloud = deform(binding, lambda vertices: vertices @ pose[:3, :3].T + pose[:3, 3])
    count = len(cloud)
    np.testing.assert_allclose(cloud.means, edited.means[:count], atol=1e-5)
    np.testing.assert_allclose(cloud.scales, edited.scales[:count], atol=1e-5)
    # A quaternion and its negative are one orientation.
    same = np.sign((cloud.quats * edited.quats[:count]).sum(1, keepdims=True))
    np.testing.assert_allclose(same * cloud.quats, edited.quats[:count], atol=1e-5)
    np.testing.assert_array_equal(cloud.colours, edited.colours[:count])


def test_the_control_moves_centres_alone():
    binding = create_binding("soft", column(), 1, band=0.01, seed=0)
    rest, whole, control = binding.evaluate(), deform(binding, bend(0.8)), shift_only(binding, bend(0.8))
    np.testing.assert_array_equal(control.means, whole.means)
    np.testing.assert_array_equal(control.quats, rest.quats)
    np.testing.assert_array_equal(control.scales, rest.scales)
    assert np.abs(whole.quats - rest.quats).max() > 0.1


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


def test_the_page_s_own_deformation_leans_the_splats(tmp_path, monkeypatch):
    (text,) = blocks(ROOT / "docs/splats.md", "python")
    path = tmp_path / "results/scenes/mug/splats/soft/binding.npz"
    path.parent.mkdir(parents=True)
    write_binding(path, create_binding("soft", column(), 2, band=0.01, seed=0))
    monkeypatch.chdir(tmp_path)
    exec(compile(text, "splats", "exec"), {})
    rest, leaning = read_binding(path).evaluate(), read_ply(tmp_path / "leaning.ply")
    # A shear is the same for a splat as for the face it lies on.
    np.testing.assert_allclose(leaning.means - rest.means, 0.3 * rest.means[:, 2:] * [1, 0, 0], atol=1e-5)
