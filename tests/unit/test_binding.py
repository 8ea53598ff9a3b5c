"""Bindings: the paper's equations written out, deformation of the mesh, files."""

import numpy as np
import pytest
import torch
import trimesh

from gsbridge.configuration.bindings import BINDINGS
from gsbridge.errors import InputError
from gsbridge.geometry import Similarity, rotation_from_quat
from gsbridge.meshes import Mesh
from gsbridge.splats.binding import FLATNESS, create_binding, face_frames, moving_frames, read_binding, write_binding
from gsbridge.splats.remesh import remesh_isotropic

BOUND = [kind for kind in BINDINGS if kind != "unbound"]


def sphere() -> Mesh:
    ball = trimesh.creation.icosphere(2, 0.05)
    return Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))


def disturbed(kind: str, mesh: Mesh):
    """A binding whose parameters are not at their start."""
    binding = create_binding(kind, mesh, 2, band=0.01, seed=1)
    generator = torch.Generator().manual_seed(2)
    for name, value in binding.parameters.items():
        value += 0.3 * torch.randn(value.shape, generator=generator) * {"means": 0.003, "vertices": 0.0}.get(name, 1)
    binding.settle()
    return binding


def covariances(cloud) -> np.ndarray:
    rotation = rotation_from_quat(cloud.quats)
    return np.einsum("nij,nj,nkj->nik", rotation, cloud.scales.astype(np.float64) ** 2, rotation)


def test_soft_follows_the_papers_equation():
    mesh = sphere()
    binding = disturbed("soft", mesh)
    cloud = binding.evaluate()
    for i in (0, 17, 300, len(binding) - 1):
        v1, v2, v3 = mesh.vertices[mesh.faces[binding.face_index[i]]]
        raw = np.maximum(binding.parameters["weights"][i].numpy().astype(np.float64), 0) + 1e-8
        w1, w2, w3 = raw / raw.sum()
        normal = np.cross(v2 - v1, v3 - v1)
        normal /= np.linalg.norm(normal)
        offset = 0.01 * np.tanh(float(binding.parameters["offset"][i]))
        np.testing.assert_allclose(cloud.means[i], w1 * v1 + w2 * v2 + w3 * v3 + offset * normal, atol=1e-7)
        # The shape as in GaMeS: axes normal, centroid to second corner, and the rest of the third.
        centroid = (v1 + v2 + v3) / 3
        along = (v2 - centroid) / np.linalg.norm(v2 - centroid)
        rest = v3 - centroid
        rest -= (rest @ along) * along + (rest @ normal) * normal
        factor = max(float(binding.parameters["multiplier"][i]), 0)
        spread = np.array([np.linalg.norm(v2 - centroid) / 2, (rest @ rest / np.linalg.norm(rest)) / 2]) * factor
        np.testing.assert_allclose(cloud.scales[i], [FLATNESS, *spread], rtol=1e-4, atol=2e-8)
        axes = rotation_from_quat(cloud.quats[i])
        np.testing.assert_allclose(axes[:, 0], normal, atol=1e-5)
        np.testing.assert_allclose(axes[:, 1], along, atol=1e-5)


def test_games_stays_inside_its_faces():
    mesh = sphere()
    binding = disturbed("games", mesh)
    corners = mesh.corners()[binding.face_index]
    inside = trimesh.triangles.points_to_barycentric(corners, binding.evaluate().means.astype(np.float64))
    assert inside.min() > -1e-4
    heights = ((binding.evaluate().means - corners[:, 0]) * mesh.normals()[binding.face_index]).sum(1)
    assert np.abs(heights).max() < 1e-7
    assert float(binding.offsets().abs().max()) == 0


def test_every_kind_starts_from_the_same_splats():
    clouds = {kind: create_binding(kind, sphere(), 2, band=0.01, seed=5).evaluate() for kind in BINDINGS}
    for kind in BINDINGS:
        np.testing.assert_allclose(clouds[kind].means, clouds["games"].means, atol=1e-7)
        np.testing.assert_allclose(clouds[kind].scales[:, 1:], clouds["games"].scales[:, 1:], rtol=1e-3)
        np.testing.assert_array_equal(clouds[kind].opacities, clouds["games"].opacities)
    other = create_binding("soft", sphere(), 2, band=0.01, seed=6).evaluate()
    assert np.abs(other.means - clouds["soft"].means).max() > 1e-4


@pytest.mark.parametrize("kind", BOUND)
def test_moving_the_mesh_rigidly_moves_the_splats(kind):
    mesh = sphere()
    binding = disturbed(kind, mesh)
    motion = Similarity(1.0, rotation_from_quat(np.array([0.9, 0.1, -0.4, 0.2])), np.array([0.2, 0.1, -0.3]))
    moved = binding.evaluate(motion.apply(mesh.vertices))
    expected = binding.evaluate().transformed(motion)
    np.testing.assert_allclose(moved.means, expected.means, atol=1e-6)
    np.testing.assert_allclose(covariances(moved), covariances(expected), atol=1e-8)


@pytest.mark.parametrize("kind", BOUND)
def test_bending_the_mesh_turns_normals_and_offsets(kind):
    """A strip whose right half is folded upright: its splats must end beside the fold, which old normals would not give."""
    flat = np.array([[x, y, 0.0] for x in (0.0, 0.1, 0.2) for y in (0.0, 0.1)])
    folded = flat.copy()
    folded[4:] = [[0.1, 0.0, 0.1], [0.1, 0.1, 0.1]]
    strip = Mesh(flat, np.array([[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]]))
    binding = disturbed(kind, strip)
    before, after = binding.evaluate().means, binding.evaluate(folded).means
    left, right = binding.face_index < 2, binding.face_index >= 2
    np.testing.assert_allclose(after[left], before[left], atol=1e-7)
    np.testing.assert_allclose(after[right, 0], 0.1 - before[right, 2], atol=1e-7)
    np.testing.assert_allclose(after[right, 1], before[right, 1], atol=1e-7)
    np.testing.assert_allclose(after[right, 2], before[right, 0] - 0.1, atol=1e-7)


def test_moving_frames_are_the_frames_and_have_gradients():
    mesh = sphere()
    vertices, faces = torch.as_tensor(mesh.vertices), torch.as_tensor(mesh.faces)
    for found, expected in zip(moving_frames(vertices, faces), face_frames(mesh.vertices, mesh.faces), strict=True):
        # A quaternion and its opposite are one orientation.
        sign = torch.sign((found * expected).sum(1, keepdim=True)) if found.shape[1:] == (4,) else 1.0
        torch.testing.assert_close((found * sign).float(), expected, atol=1e-5, rtol=1e-5)
    corner, one = 1000 * vertices[faces[7]], torch.tensor([[0, 1, 2]])

    def shape(places):
        # The sign of a quaternion may change with the way it is found, its products do not.
        _, normals, quats, spreads = moving_frames(places, one)
        return normals, quats[:, :, None] * quats[:, None], spreads

    assert torch.autograd.gradcheck(shape, corner.requires_grad_())


def test_vertices_move_until_they_settle(tmp_path):
    mesh = sphere()
    binding = create_binding("games_vertices", mesh, 2, band=0.01, seed=1)
    with torch.no_grad():
        binding.parameters["vertices"] *= 1.1
    expected = create_binding("games", Mesh(1.1 * mesh.vertices, mesh.faces), 2, band=0.01, seed=1)
    np.testing.assert_allclose(binding.evaluate().means, expected.evaluate().means, atol=1e-8)
    binding.settle()
    assert "vertices" not in binding.parameters
    np.testing.assert_allclose(binding.vertices, 1.1 * mesh.vertices, rtol=1e-6)
    np.testing.assert_allclose(covariances(binding.evaluate()), covariances(expected.evaluate()), atol=1e-9)
    write_binding(tmp_path / "binding.npz", binding)
    np.testing.assert_array_equal(read_binding(tmp_path / "binding.npz").vertices, binding.vertices)


def test_stretching_the_mesh_stretches_the_splats():
    mesh = sphere()
    binding = disturbed("soft", mesh)
    before, after = binding.evaluate(), binding.evaluate(3 * mesh.vertices)
    visible = before.scales[:, 1] > 1e-6
    np.testing.assert_allclose(after.scales[visible, 1:], 3 * before.scales[visible, 1:], rtol=1e-3)


def test_unbound_does_not_follow_a_mesh():
    mesh = sphere()
    binding = create_binding("unbound", mesh, 1, band=0.01, seed=0)
    with pytest.raises(ValueError, match="do not follow"):
        binding.evaluate(mesh.vertices)
    with pytest.raises(ValueError, match="vertices"):
        create_binding("soft", mesh, 1, band=0.01, seed=0).evaluate(mesh.vertices[:-1])
    with pytest.raises(ValueError, match="one of"):
        create_binding("glued", mesh, 1, band=0.01, seed=0)


def test_faces_without_area_give_finite_splats():
    frames = face_frames(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 0]]), np.array([[0, 1, 2], [0, 0, 3]]))
    assert all(torch.isfinite(item).all() for item in frames)


@pytest.mark.parametrize("kind", BINDINGS)
def test_file_round_trip(tmp_path, kind):
    binding = disturbed(kind, sphere())
    write_binding(tmp_path / "binding.npz", binding)
    back = read_binding(tmp_path / "binding.npz")
    assert back.kind == kind
    np.testing.assert_array_equal(back.evaluate().means, binding.evaluate().means)
    np.testing.assert_array_equal(back.evaluate().quats, binding.evaluate().quats)


def test_a_damaged_file_gives_one_clear_line(tmp_path):
    path = tmp_path / "binding.npz"
    write_binding(path, create_binding("soft", sphere(), 1, band=0.01, seed=0))
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(InputError, match=r"binding\.npz"):
        read_binding(path)
    path.write_bytes(b"")
    with pytest.raises(InputError, match=r"binding\.npz"):
        read_binding(path)
    with pytest.raises(InputError, match="does not exist"):
        read_binding(tmp_path / "none.npz")


def test_remeshing_a_closed_surface():
    ball = trimesh.creation.box((0.04, 0.06, 0.08))
    mesh = remesh_isotropic(Mesh(np.asarray(ball.vertices), np.asarray(ball.faces)), 600)
    assert 500 < len(mesh.faces) <= 600
    assert mesh.is_watertight()
    assert mesh.volume() == pytest.approx(0.04 * 0.06 * 0.08, rel=0.02)
    corners = mesh.corners()
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert np.percentile(edges, 95) / np.percentile(edges, 5) < 2.2


def test_unseen_parts_get_larger_faces_and_the_rest_smaller_ones():
    ball = trimesh.creation.icosphere(4, 0.05)
    surface = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))

    def upper(mesh: Mesh) -> np.ndarray:
        return mesh.corners().mean(1)[:, 2] > 0

    even, mesh = remesh_isotropic(surface, 1000), remesh_isotropic(surface, 1000, seen=upper)
    assert len(mesh.faces) <= 1000
    assert mesh.is_watertight()
    assert mesh.volume() == pytest.approx(surface.volume(), rel=0.04)
    assert upper(mesh).sum() > 1.3 * upper(even).sum()
    again = remesh_isotropic(surface, 1000)
    np.testing.assert_array_equal(again.faces, even.faces)


def test_remeshing_an_open_surface_keeps_its_border():
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 12), np.linspace(-0.4, 0.4, 10))
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    plane = Mesh(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1), np.concatenate([np.c_[a, b, c], np.c_[a, c, d]]))
    mesh = remesh_isotropic(plane, 800)
    assert len(mesh.faces) <= 800
    assert mesh.areas().sum() == pytest.approx(0.8, rel=1e-3)
    np.testing.assert_allclose(mesh.vertices.min(0), [-0.5, -0.4, 0], atol=1e-3)
    assert (mesh.normals()[:, 2] > 0.99).all()
    with pytest.raises(ValueError, match="limit"):
        remesh_isotropic(plane, 3)


def test_sizes_that_are_asked_for_are_met():
    grid = trimesh.creation.box((1.0, 1.0, 0.001))
    surface = Mesh(np.asarray(grid.vertices), np.asarray(grid.faces))

    def sizes(mesh: Mesh) -> np.ndarray:
        """Four times as fine in the middle as at the border."""
        away = np.abs(mesh.corners().mean(1)[:, :2]).max(1)
        return np.where(away < 0.2, 0.5, np.where(away > 0.4, 2.0, 1.0))

    mesh = remesh_isotropic(surface, 6000, sizes=sizes)
    assert 0.9 * 6000 < len(mesh.faces) <= 6000
    assert mesh.volume() == pytest.approx(0.001, rel=0.02)
    edge, wanted = np.sqrt(mesh.areas()), sizes(mesh)
    medians = [np.median(edge[wanted == size]) for size in (0.5, 1.0, 2.0)]
    assert medians[1] / medians[0] == pytest.approx(2.0, rel=0.2)
    # The border of 10 cm holds few faces of the largest size, and grading needs room.
    assert medians[2] / medians[1] > 1.3
