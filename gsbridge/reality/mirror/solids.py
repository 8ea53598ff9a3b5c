"""Shapes of the mirror as signed distances, and meshes of them.

Lengths inside this module are in millimetres, because the shapes are defined in millimetres; meshes are returned in metres.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from skimage.measure import marching_cubes

from gsbridge.geometry import Array
from gsbridge.meshes import Mesh

Distance = Callable[[Array], Array]


def ellipsoid(p: Array, centre: tuple[float, float, float], radii: tuple[float, float, float], tilt: float = 0.0) -> Array:
    """Return the approximate signed distance to an ellipsoid.

    Args:
        p: Points, mm. [N, 3].
        centre: Centre of the ellipsoid, mm.
        radii: Half axes of the ellipsoid, mm.
        tilt: Turn about y, rad.

    Returns:
        Distances, mm. [N]. Source: Quilez, "Ellipsoid".
    """
    # Work column by column: numpy's sums over an axis of length three are slow, and the results are bitwise the same.
    x, y, z = (p[:, k] - centre[k] for k in range(3))
    if tilt:
        c, s = np.cos(tilt), np.sin(tilt)
        x, z = c * x - s * z, s * x + c * z
    k0, k1 = (_length(x / a, y / b, z / d) for a, b, d in (radii, np.square(radii)))
    return k0 * (k0 - 1) / np.maximum(k1, 1e-9)


def _length(x: Array, y: Array, z: Array) -> Array:
    """Return the lengths of vectors. [N] each -> [N]."""
    return np.sqrt(x * x + y * y + z * z)


def merge(*distances: Array, soft: float = 4.0) -> Array:
    """Return the union of shapes, with seams rounded over about `soft` mm. Source: Quilez, polynomial smooth minimum."""
    total = distances[0]
    for other in distances[1:]:
        h = np.maximum(soft - np.abs(total - other), 0) / soft
        total = np.minimum(total, other) - h * h * soft / 4
    return total


def mesh_of(distance: Distance, low: tuple[float, ...], high: tuple[float, ...], cell: float) -> tuple[Array, Array, Array]:
    """Return the watertight mesh of a signed distance, cut flat at z = 0.

    Args:
        distance: Signed distance, mm, negative inside. [N, 3] -> [N].
        low, high: Box to search, mm.
        cell: Grid spacing, mm.

    Returns:
        Vertices [V, 3] and outward normals [V, 3] (m), faces [F, 3].
    """
    # Shift the grid by an odd fraction of a cell, so that no plane of a shape passes through grid points, which would give
    # degenerate triangles.
    axes = [np.arange(a - 2 * cell - 0.37 * cell, b + 2 * cell, cell) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    field = np.concatenate(
        [np.maximum(distance(part), -part[:, 2]) for part in np.array_split(grid, max(1, len(grid) // 400_000))]
    )
    field = field.reshape([len(axis) for axis in axes])
    vertices, faces, _, _ = marching_cubes(field.astype(np.float32), 0.0, spacing=(cell,) * 3, gradient_direction="ascent")
    vertices = (vertices + [axis[0] for axis in axes]) * 1e-3
    mesh = Mesh(vertices.astype(np.float64), faces.astype(np.int64))
    if mesh.volume() < 0:
        mesh = Mesh(mesh.vertices, mesh.faces[:, ::-1])
    return mesh.vertices, vertex_normals(mesh), mesh.faces


def vertex_normals(mesh: Mesh) -> Array:
    """Return area-weighted vertex normals. [V, 3]."""
    weighted = mesh.normals() * mesh.areas()[:, None]
    total = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(total, mesh.faces[:, corner], weighted)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)


def box(p: Array, centre: Sequence[float], half: Sequence[float], rounding: float = 0.0) -> Array:
    """Return the signed distance to an upright box with rounded edges.

    Args:
        p: Points, mm. [N, 3].
        centre: Centre of the box, mm.
        half: Half the lengths of the box's sides, rounding included, mm.
        rounding: Radius of the edges, mm.

    Returns:
        Distances, mm. [N]. Source: Quilez, "Round box".
    """
    q = np.abs(p - np.asarray(centre)) - (np.asarray(half) - rounding)
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0) - rounding


def rod(p: Array, start: Sequence[float], end: Sequence[float], radius: float) -> Array:
    """Return the signed distance to a rod with round ends.

    Args:
        p: Points, mm. [N, 3].
        start: Centre of one round end, mm.
        end: Centre of the other round end, mm.
        radius: Radius of the rod, mm.

    Returns:
        Distances, mm. [N]. Source: Quilez, "Capsule".
    """
    a, way = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64) - np.asarray(start)
    along = np.clip((p - a) @ way / (way @ way), 0, 1)
    return np.linalg.norm(p - a - along[:, None] * way, axis=-1) - radius


def turned(p: Array, profile: Sequence[tuple[float, float]], rounding: float = 0.0) -> Array:
    """Return the signed distance to a solid of revolution about z.

    Args:
        p: Points, mm. [N, 3].
        profile: Corners (radius, height) of half the solid's section, in order, mm.
        rounding: Radius by which the section grows, which rounds its corners, mm.

    Returns:
        Distances, mm. [N]. Source: Quilez, "Polygon".
    """
    q = np.stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]], axis=-1)
    corners = np.asarray(profile, dtype=np.float64)
    nearest = np.full(len(q), np.inf)
    inside = np.zeros(len(q), bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        way, away = b - a, q - a
        along = np.clip(away @ way / (way @ way), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(away - along[:, None] * way, axis=-1))
        crosses = (a[1] <= q[:, 1]) != (b[1] <= q[:, 1])
        inside ^= crosses & (way[0] * away[:, 1] / (way[1] if way[1] else 1.0) > away[:, 0])
    return np.where(inside, -nearest, nearest) - rounding
