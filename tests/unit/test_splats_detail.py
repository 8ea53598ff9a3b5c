"""Sizes of a background's triangles: from photos of a table that is detailed in one half only."""

import numpy as np
import pytest

from gsbridge.cameras import Camera, look_at
from gsbridge.meshes import Mesh
from gsbridge.splats.detail import Focus, edge_sizes
from gsbridge.splats.targets import Target

CAMERA = Camera(320, 240, 300.0, 300.0, 160.0, 120.0)


def table(half: float = 0.4, count: int = 41) -> Mesh:
    x = np.linspace(-half, half, count)
    grid = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((count, count))], axis=-1).reshape(-1, 3)
    a = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    return Mesh(grid, np.concatenate([np.c_[a, a + count, a + 1], np.c_[a + 1, a + count, a + count + 1]]))


def photos(colour, count: int = 8, split: str = "train") -> list[Target]:
    """Photos of a function of x and y, from a circle."""
    out = []
    for angle in np.arange(count) * 2 * np.pi / count:
        pose = look_at(np.array([0.4 * np.cos(angle), 0.4 * np.sin(angle), 0.6]), np.zeros(3))
        eye = -pose[:3, :3].T @ pose[:3, 3]
        rays = CAMERA.pixel_rays() @ pose[:3, :3]
        hits = eye + rays * (-eye[2] / rays[..., 2])[..., None]
        photo = np.repeat(np.rint(255 * colour(*hits[..., :2].transpose(2, 0, 1)))[..., None], 3, axis=2).astype(np.uint8)
        weight = np.where(np.abs(hits[..., :2]).max(-1) < 0.4, 255, 0).astype(np.uint8)
        out.append(Target("a", split, CAMERA, pose, photo, weight, photo, 0, 0, CAMERA))
    return out


def stripes(x, y):
    """Plain where x < 0, stripes of 8 mm elsewhere."""
    return np.where(x > 0, 0.5 + 0.4 * np.sign(np.sin(2 * np.pi * y / 0.016)), 0.5)


def at(sizes, mesh: Mesh, inside) -> float:
    centres = mesh.corners().mean(1)
    return float(np.median(sizes(mesh)[inside(centres[:, 0], centres[:, 1])]))


def test_detail_makes_small_triangles():
    mesh = table()
    sizes = edge_sizes(mesh, photos(stripes))
    fine = at(sizes, mesh, lambda x, y: (x > 0.05) & (np.hypot(x, y) < 0.25))
    plain = at(sizes, mesh, lambda x, y: (x < -0.05) & (np.hypot(x, y) < 0.25))
    # The variance of the stripes is 1600 times the floor, so a quarter power of it is 6; bounds cut that.
    assert 3.0 < plain / fine < 7.0


def test_focus_divides_sizes_by_the_quarter_power_of_its_gain():
    mesh, seen = table(), photos(lambda x, y: np.full_like(x, 0.5))
    plain, focused = edge_sizes(mesh, seen), edge_sizes(mesh, seen, Focus((0.1, 0.0), 0.1, 16.0))

    def inside(x, y):
        return np.maximum(np.abs(x - 0.1), np.abs(y)) < 0.04

    def outside(x, y):
        return np.hypot(x + 0.1, y) < 0.05

    ratio = at(focused, mesh, inside) / at(focused, mesh, outside) / (at(plain, mesh, inside) / at(plain, mesh, outside))
    assert ratio == pytest.approx(0.5, abs=0.05)
    assert np.median(plain(mesh)) == pytest.approx(1.0, abs=0.1)


def test_held_out_photos_are_not_looked_at():
    mesh = table()
    plain = photos(lambda x, y: np.full_like(x, 0.5))
    with_more = [*plain, *photos(stripes, split="held_out")]
    np.testing.assert_array_equal(edge_sizes(mesh, plain)(mesh), edge_sizes(mesh, with_more)(mesh))
