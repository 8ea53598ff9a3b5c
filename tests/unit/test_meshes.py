"""Mesh figures against trimesh."""

import numpy as np
import pytest
import trimesh

from gsbridge.errors import InputError
from gsbridge.meshes import Mesh, read_mesh, write_mesh


@pytest.fixture
def ball():
    sphere = trimesh.creation.icosphere(3, 0.05)
    return Mesh(np.asarray(sphere.vertices), np.asarray(sphere.faces), np.full((len(sphere.vertices), 3), 0.25, np.float32))


def test_volume_and_watertightness_agree_with_trimesh(ball):
    assert ball.volume() == pytest.approx(ball.trimesh().volume)
    assert ball.areas().sum() == pytest.approx(ball.trimesh().area)
    assert ball.is_watertight()
    assert not Mesh(ball.vertices, ball.faces[1:]).is_watertight()
    flipped = ball.faces.copy()
    flipped[0] = flipped[0][::-1]
    assert not Mesh(ball.vertices, flipped).is_watertight()


def test_normals_point_outwards(ball):
    assert (np.einsum("ij,ij->i", ball.normals(), ball.corners().mean(1)) > 0).all()


def test_round_trip_keeps_shape_and_colour(ball, tmp_path):
    write_mesh(tmp_path / "ball.ply", ball)
    found = read_mesh(tmp_path / "ball.ply")
    np.testing.assert_allclose(found.vertices, ball.vertices, atol=1e-7)
    np.testing.assert_array_equal(found.faces, ball.faces)
    np.testing.assert_allclose(found.colours, ball.colours, atol=0.5 / 255 + 1e-6)


@pytest.mark.parametrize("content", [b"", b"ply\nformat binary_little_endian 1.0\nelement vertex 5\n", b"text"])
def test_corrupt_mesh_is_named(tmp_path, content):
    path = tmp_path / "bad.ply"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"bad\.ply"):
        read_mesh(path)
    with pytest.raises(InputError, match="does not exist"):
        read_mesh(tmp_path / "none.ply")
