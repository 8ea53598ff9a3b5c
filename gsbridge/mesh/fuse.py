"""One closed surface from confirmed depth, the hull where depth is missing, and the table below."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from gsbridge.cameras import View
from gsbridge.carving import Grid, mesh_depth
from gsbridge.geometry import Array
from gsbridge.libraries import import_open3d
from gsbridge.mesh.depth import Cloud
from gsbridge.mesh.hull import Hull
from gsbridge.mesh.repair import signed_field
from gsbridge.mesh.settings import MeshSettings
from gsbridge.meshes import Mesh

logger = logging.getLogger("gsbridge")

_MIN_FACING = 0.45
"""Cosine at which a view must face a hull point for it to count as seen."""
_FIELD_VOXELS = 128
"""Samples along the longest side of the grid on which the surface is closed."""


def surface_samples(mesh: Mesh, spacing: float, seed: int) -> tuple[Array, Array]:
    """Points spread over a mesh, about `spacing` apart, with the faces' normals. [N, 3], [N, 3]."""
    areas = mesh.areas()
    count = int(areas.sum() / spacing**2)
    rng = np.random.default_rng(seed)
    picked = rng.choice(len(areas), size=count, p=areas / areas.sum())
    a, b = rng.random((2, count))
    flip = a + b > 1
    a[flip], b[flip] = 1 - a[flip], 1 - b[flip]
    corners = mesh.corners()[picked]
    points = corners[:, 0] + a[:, None] * (corners[:, 1] - corners[:, 0]) + b[:, None] * (corners[:, 2] - corners[:, 0])
    return points, mesh.normals()[picked]


def unexplained(points: Array, normals: Array, hull: Hull, cloud: Cloud, views: Sequence[View], spacing: float) -> Array:
    """Hull points that some view faces and no confirmed depth replaces. [N, 3], [N, 3] -> [N] bool.

    A hull point that a view sees where that view has a confirmed depth is either confirmed or, in a hollow, refuted by it; it
    is needed only where no view that sees it measured anything, and no measured point is near.
    """
    measured = np.zeros(len(points), np.int32)
    facing = np.full(len(points), -1.0)
    for view in views:
        rays = view.centre - points
        facing = np.maximum(facing, (rays * normals).sum(1) / np.linalg.norm(rays, axis=1))
    for view, confirmed in zip(cloud.views, cloud.confirmed, strict=True):
        camera = view.camera
        lattice = camera.scaled(confirmed.shape[1] / camera.width)
        front = mesh_depth(hull.mesh.vertices, hull.mesh.faces, lattice, view.cam_from_table)
        # Gaps of a few pixels between confirmed depths lie on the same surface.
        closed = ndimage.binary_closing(confirmed, iterations=2)
        local = points @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3]
        index = np.floor(np.nan_to_num(lattice.project(local), nan=-1)).astype(int)
        valid = (index >= 0).all(axis=1) & (index[:, 0] < confirmed.shape[1]) & (index[:, 1] < confirmed.shape[0])
        columns, rows = index[valid, 0], index[valid, 1]
        visible = local[valid, 2] < front[rows, columns] + 2 * hull.grid.spacing
        measured[np.flatnonzero(valid)[visible & closed[rows, columns]]] += 1
    # The back of a hull that no view faces is the far end of the viewing cones, not a surface; the fit closes it better.
    free = (measured < 2) & (facing > _MIN_FACING)
    if len(cloud.points):
        free &= cKDTree(cloud.points).query(points, distance_upper_bound=2.5 * spacing)[0] > 2.5 * spacing
    return free


def bottom_samples(hull: Hull, spacing: float) -> tuple[Array, Array]:
    """Points on the object's footprint, looking down. [N, 3], [N, 3]."""
    layer = int(np.argmin(np.abs(hull.grid.axis(2))))
    step = max(1, round(spacing / hull.grid.spacing))
    foot = hull.field[:, :, layer + 1] > 0
    index = np.argwhere(foot)
    index = index[(index % step == 0).all(axis=1)]
    points = np.c_[hull.grid.origin[:2] + hull.grid.spacing * index, np.zeros(len(index))]
    return points, np.tile([0.0, 0.0, -1.0], (len(points), 1))


def poisson(points: Array, normals: Array, depth: int, threads: int) -> Mesh:
    """Screened Poisson surface of oriented points.

    Source: Kazhdan, Hoppe, ACM TOG 32(3), 2013 (open3d's build).
    """
    open3d = import_open3d()
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.normals = open3d.utility.Vector3dVector(normals)
    surface, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=depth, scale=1.25, linear_fit=False, n_threads=threads
    )
    return Mesh(np.asarray(surface.vertices).copy(), np.asarray(surface.triangles).astype(np.int64))


def fuse(
    hull: Hull, cloud: Cloud, views: Sequence[View], settings: MeshSettings, *, narrow: bool, seed: int, threads: int
) -> tuple[Grid, Array, dict[str, float]]:
    """Solid of an object as a signed distance.

    Args:
        hull: Visual hull.
        cloud: Confirmed depth.
        views: The views, whatever their size.
        settings: See `MeshSettings`.
        narrow: The views show one side only.
        seed: Seed of the hull's samples.
        threads: Threads to use.

    Returns:
        Grid, signed distance (positive inside, cut at the table) [nx, ny, nz], and figures: points from depth and hull.
    """
    spacing = 0.009 * hull.size
    samples, normals = surface_samples(hull.mesh, spacing, seed)
    side = samples[:, 2] > 0.5 * hull.grid.spacing
    samples, normals = samples[side], normals[side]
    needed = unexplained(samples, normals, hull, cloud, views, spacing)
    foot, down = bottom_samples(hull, spacing)
    if narrow and len(cloud.points):
        # The foot of a hull seen from one side reaches far behind the object.
        close = cKDTree(cloud.points[:, :2]).query(foot[:, :2])[0] < 0.08 * hull.size
        foot, down = foot[close], down[close]
    points = np.concatenate([cloud.points, samples[needed], foot])
    directions = np.concatenate([cloud.normals, normals[needed], down])
    figures = {"depth_points": len(cloud.points), "hull_points": int(needed.sum()), "hull_share": float(needed.mean())}
    surface = poisson(points, directions, settings.poisson_depth, threads)
    low = np.array([*hull.mesh.vertices.min(0)[:2], 0.0])
    high = hull.mesh.vertices.max(0)
    step = float((high - low).max()) / _FIELD_VOXELS
    low, high = low - 3 * step, high + 3 * step
    grid = Grid.covering(np.array([low[0], low[1], -2 * step]), high, step)
    field = signed_field(surface, grid)
    # Poisson may bulge where nothing holds it; nothing can lie beyond the hull, give or take its own error.
    index = (grid.points() - hull.grid.origin) / hull.grid.spacing
    limit = ndimage.map_coordinates(hull.uncut, index.T, order=1, mode="nearest").reshape(grid.shape)
    field = np.minimum(field, limit + 0.012 * hull.size)
    field = np.minimum(field, grid.axis(2)[None, None, :]).astype(np.float32)
    return grid, field, figures


def vertex_colours(mesh: Mesh, views: Sequence[View], images: Sequence[Array]) -> Array:
    """Colours of vertices from the photos that see them best. [V, 3] float32.

    Args:
        mesh: The mesh.
        views: Views at the images' sizes.
        images: RGB, 0..1. [H, W, 3] each.
    """
    normals = mesh.trimesh().vertex_normals
    total = np.zeros((len(mesh.vertices), 3))
    weight = np.full(len(mesh.vertices), 1e-9)
    slack = 0.01 * float(np.ptp(mesh.vertices, axis=0).max())
    for view, image in zip(views, images, strict=True):
        pose, camera = view.cam_from_table, view.camera
        local = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        index = np.floor(np.nan_to_num(camera.project(local), nan=-1)).astype(int)
        valid = (index >= 0).all(axis=1) & (index[:, 0] < camera.width) & (index[:, 1] < camera.height)
        depth = mesh_depth(mesh.vertices, mesh.faces, camera, pose)
        rays = view.centre - mesh.vertices
        cosine = (rays * normals).sum(1) / np.linalg.norm(rays, axis=1)
        rows, columns = np.where(valid, index[:, 1], 0), np.where(valid, index[:, 0], 0)
        seen = valid & (cosine > 0.2) & (local[:, 2] < depth[rows, columns] + slack)
        # A high power lets the most frontal photos win: an even mean would blur the texture.
        gain = np.where(seen, np.maximum(cosine, 0) ** 6, 0.0)
        total += gain[:, None] * image[rows, columns]
        weight += gain
    colours = total / weight[:, None]
    seen = weight > 1e-6
    if seen.any() and not seen.all():
        colours[~seen] = colours[seen][cKDTree(mesh.vertices[seen]).query(mesh.vertices[~seen])[1]]
    return colours.astype(np.float32)
