"""Occlusion of the sky by bodies: each body as a few spheres, and the share of each direction's light that they let through."""

from __future__ import annotations

from gsbridge.kernels import Real, njit  # isort: skip  (first: it sets numba's cache folder)

import math

import numpy as np

from gsbridge.geometry import Array
from gsbridge.libraries import import_open3d
from gsbridge.meshes import Mesh

POINTS = 4000
"""Approximate greatest number of grid points in a body's bounding box; spheres are centred on those inside, and cover them."""

SHARE = 0.97
"""Share of the grid points inside a body that its spheres have to cover."""


def spheres_in(mesh: Mesh, count: int) -> Array:
    """Fill a body with spheres, chosen one by one; each covers as many points as possible that are still uncovered.

    Args:
        mesh: Closed surface, m.
        count: Spheres, at most.

    Returns:
        Centre and radius, m; none where the mesh has no inside. [S, 4].
    """
    low, size = mesh.vertices.min(0), np.ptp(mesh.vertices, axis=0)
    cell = float(max(size.max() / 30, (size.prod() / POINTS) ** (1 / 3)))
    axes = [low[i] + cell * (np.arange(max(1, round(size[i] / cell))) + 0.5) for i in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    depths = _depths(mesh, points)
    points, depths = points[depths > 0], depths[depths > 0]
    if not len(points):
        return np.zeros((0, 4))
    # Half a cell is added, so that the spheres reach the surface between grid points.
    radii = depths + 0.5 * cell
    tried = np.argsort(-depths, kind="stable")[:: max(1, len(points) // 1000)]
    held = np.linalg.norm(points[tried][:, None] - points[None], axis=-1) < radii[tried][:, None]
    left = np.ones(len(points), bool)
    out: list[list[float]] = []
    while len(out) < count and left.mean() > 1 - SHARE:
        gains = (held & left).sum(1)
        best = int(np.argmax(gains))
        if gains[best] == 0:
            break
        out.append([*points[tried[best]], radii[tried[best]]])
        left &= ~held[best]
    return np.array(out)


def _depths(mesh: Mesh, points: Array) -> Array:
    """Distance of points from a surface, positive inside. [N]."""
    open3d = import_open3d()
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(open3d.core.Tensor(mesh.vertices.astype(np.float32)), open3d.core.Tensor(mesh.faces.astype(np.uint32)))
    distances = scene.compute_signed_distance(open3d.core.Tensor(points.astype(np.float32)), nthreads=1)
    return -np.asarray(distances.numpy(), dtype=np.float64)


def moved(spheres: Array, pose: Array) -> Array:
    """Spheres of a body at a pose. [S, 4], [4, 4] -> [S, 4]."""
    return np.concatenate([spheres[:, :3] @ pose[:3, :3].T + pose[:3, 3], spheres[:, 3:]], axis=1)


@njit(error_model="numpy", fastmath=True)
def left_by(px: float, py: float, pz: float, sphere: Array, dx: float, dy: float, dz: float, width: Real) -> Real:
    """Share of the light of a disc-shaped source in some direction that a sphere lets through to a point.

    Args:
        px, py, pz: The point, m.
        sphere: Centre and radius, m. [4].
        dx, dy, dz: Unit vector towards the light.
        width: Radius of the source's disc at unit distance, which is the tangent of its half angle.

    Returns:
        0 where the sphere hides all of the light, 1 where it hides nothing.
    """
    x, y, z, radius = sphere[0] - px, sphere[1] - py, sphere[2] - pz, sphere[3]
    along = x * dx + y * dy + z * dz
    square = x * x + y * y + z * z
    # A sphere behind the point does not shade it, and a sphere that contains the point is part of the point's own body.
    if along <= 0.0 or square <= radius * radius:
        return np.float32(1.0)
    half = width * along + np.float32(1e-4)
    across = square - along * along
    if across >= (radius + half) * (radius + half):
        return np.float32(1.0)
    # The ramp runs from where the discs of sphere and source touch to where one lies within the other. A sphere smaller than
    # the source never hides all of it.
    ramp = (radius + half - math.sqrt(max(across, np.float32(0.0)))) / (np.float32(2.0) * min(radius, half))
    return np.float32(1.0) - min(ramp, np.float32(1.0)) * min(radius * radius / (half * half), np.float32(1.0))


@njit(error_model="numpy", fastmath=True)
def _transmittances(points: Array, spheres: Array, directions: Array, width: Real, out: Array) -> None:
    for i in range(points.shape[0]):
        for m in range(directions.shape[0]):
            left: Real = np.float32(1.0)
            for s in range(spheres.shape[0]):
                left = min(
                    left,
                    left_by(
                        points[i, 0], points[i, 1], points[i, 2], spheres[s],
                        directions[m, 0], directions[m, 1], directions[m, 2], width,
                    ),
                )  # fmt: skip
            out[i, m] = left


def transmittances(points: Array, spheres: Array, directions: Array, width: float) -> Array:
    """Share of each direction's light that reaches each point; of the spheres in the way, only the one that hides most counts.

    Args:
        points: Points that light falls on, m. [N, 3].
        spheres: Centre and radius, m. [S, 4].
        directions: Unit vectors towards the light. [M, 3].
        width: Half angle of each direction's source, rad.

    Returns:
        0..1. [N, M] float32.
    """
    out = np.ones((len(points), len(directions)), np.float32)
    _transmittances(
        np.ascontiguousarray(points, np.float32),
        np.ascontiguousarray(spheres, np.float32),
        np.ascontiguousarray(directions, np.float32),
        np.float32(width),
        out,
    )
    return out
