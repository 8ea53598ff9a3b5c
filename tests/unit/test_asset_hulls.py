"""Convex hulls: decomposition, foot, few vertices, room for the margin."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from gsbridge.asset.hulls import decompose, filled_depth, hull_mesh, inset, seat, simplify
from gsbridge.meshes import Mesh


def corners(a: float, b: float, c: float) -> np.ndarray:
    return np.asarray(trimesh.creation.box((a, b, c)).vertices) + np.array([0, 0, c / 2])


def distances(points: np.ndarray, hull: np.ndarray) -> np.ndarray:
    """Signed distance to the planes of a hull, positive outside."""
    equations = ConvexHull(hull).equations
    return (points @ equations[:, :3].T + equations[:, 3]).max(1)


def angle() -> Mesh:
    """An L: two arms, 20 mm thick, that are 60 and 80 mm long on their inner sides."""
    outline = np.array([[-0.01, 0], [0.07, 0], [0.07, 0.02], [0.01, 0.02], [0.01, 0.1], [-0.01, 0.1]])
    count = len(outline)
    vertices = np.concatenate([np.insert(outline, 1, y, axis=1) for y in (-0.02, 0.02)])
    caps = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    sides = [[(i, (i + 1) % count, i + count), ((i + 1) % count, (i + 1) % count + count, i + count)] for i in range(count)]
    mesh = Mesh(vertices, np.concatenate([caps, caps[:, ::-1] + count, np.array(sides).reshape(-1, 3)[:, ::-1]]))
    assert mesh.is_watertight()
    return mesh if mesh.volume() > 0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])


def test_decomposition_fills_the_body_and_repeats():
    """An L of two boxes: two parts, and the space between the arms stays empty."""
    mesh = angle()
    parts = decompose(mesh, concavity=0.003, most=8, seed=1)
    assert sum(hull_mesh(part).volume() for part in parts) == pytest.approx(mesh.volume(), rel=0.02)
    assert 2 <= len(parts) <= 4
    again = decompose(mesh, concavity=0.003, most=8, seed=1)
    for part, other in zip(parts, again, strict=True):
        np.testing.assert_array_equal(part, other)
    assert len(decompose(mesh, concavity=0.2, most=8, seed=1)) == 1


def test_what_hulls_fill_is_measured_from_the_surface():
    """One hull of the L fills the triangle between its arms, x / 60 mm + y / 80 mm < 1 from the inner corner."""
    mesh = angle()
    parts = decompose(mesh, concavity=0.003, most=8, seed=1)
    assert filled_depth(parts, mesh) < 0.003
    assert filled_depth([np.asarray(mesh.vertices)], mesh) == pytest.approx(1 / (1 / 0.06 + 1 / 0.08), abs=0.0025)


def test_seat_makes_the_foot_flat():
    rng = np.random.default_rng(0)
    rough = corners(0.05, 0.05, 0.05).repeat(20, axis=0)
    rough[:, 2] += np.where(rough[:, 2] < 0.01, rng.uniform(-0.0004, 0.0008, len(rough)), 0)
    rough[:, :2] *= rng.uniform(0.5, 1.0, (len(rough), 1))
    upper = corners(0.02, 0.02, 0.02) + np.array([0, 0, 0.06])
    low, high = seat([rough, upper], 0.001)
    assert low[:, 2].min() == 0.0
    assert (low[:, 2] == 0.0).sum() == (rough[:, 2] < 0.001).sum()
    np.testing.assert_array_equal(high, upper)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_simplified_hulls_stay_within_the_tolerance(seed):
    points = np.random.default_rng(seed).normal(size=(300, 3))
    points *= 0.05 / np.linalg.norm(points, axis=1, keepdims=True)
    few = simplify(points, 0.002, 200)
    assert len(few) < 200
    assert distances(points, few).max() <= 0.002 + 1e-12
    assert {tuple(p) for p in few} <= {tuple(p) for p in points}
    assert len(simplify(points, 1e-6, 16)) == 16


def test_box_keeps_its_corners_only():
    box = trimesh.creation.box((0.04, 0.06, 0.1)).subdivide().subdivide()
    few = simplify(np.asarray(box.vertices), 1e-5, 64)
    assert len(few) == 8
    assert hull_mesh(few).volume() == pytest.approx(0.04 * 0.06 * 0.1)


def test_inset_of_a_box_and_of_a_thin_plate():
    smaller, moved = inset(corners(0.04, 0.06, 0.1), 0.001)
    assert moved == 0.001
    assert hull_mesh(smaller).volume() == pytest.approx(0.038 * 0.058 * 0.098)
    assert smaller[:, 2].min() == pytest.approx(0.001)
    plate, moved = inset(corners(0.04, 0.06, 0.002), 0.001)
    assert moved == pytest.approx(0.0005)
    assert np.ptp(plate[:, 2]) == pytest.approx(0.001)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_inset_keeps_its_distance_from_every_face(seed):
    points = np.random.default_rng(seed).normal(size=(40, 3)) * [0.05, 0.03, 0.02]
    smaller, moved = inset(points, 0.001)
    assert moved == pytest.approx(0.001)
    assert distances(smaller, points).max() == pytest.approx(-0.001, abs=1e-8)


def test_hull_meshes_are_closed_and_face_outward():
    mesh = hull_mesh(np.random.default_rng(0).normal(size=(50, 3)))
    assert mesh.is_watertight()
    assert mesh.volume() == pytest.approx(ConvexHull(mesh.vertices).volume)
