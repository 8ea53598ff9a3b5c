"""Fuse one closed surface from confirmed depth, the hull where depth is missing, and the table below."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from gsbridge.cameras import View
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.geometry import Array
from gsbridge.libraries import import_open3d
from gsbridge.mesh.depth import DepthCloud, seen_through
from gsbridge.mesh.hull import Hull
from gsbridge.mesh.repair import signed_field
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.carving import Grid, largest_component, mesh_depth, mesh_of_field

logger = logging.getLogger("gsbridge")

_WALL = 0.02
"""Thickness of the solid wall that is assumed behind a measured surface, as a share of the object's size."""
_CLEAR = 0.03
"""Points nearer than this to the table, as a share of the object's size, may be the table's own; points nearer than this to the
object's top are no inner floor."""
_MOSTLY, _PATCH = 0.8, 12
"""Share of the measured points round an upward point that must face upward as well, and their least number."""
_FLOOR = 0.3
"""Least z of the normal of a surface that counts as seen from above, as the inside of a vessel is."""


def surface_samples(mesh: Mesh, spacing: float, seed: int) -> tuple[Array, Array]:
    """Random points spread over a mesh, with the normals of their faces.

    Args:
        mesh: The mesh.
        spacing: Mean distance of neighbours, in the mesh's unit.
        seed: Random seed.

    Returns:
        Points and unit normals. [N, 3], [N, 3].
    """
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


def unexplained(points: Array, hull: Hull, cloud: DepthCloud, spacing: float) -> Array:
    """Hull points that no confirmed depth replaces. [N, 3] -> [N] bool.

    Where a view sees a hull point and has a confirmed depth there, that depth confirms the point or, in a hollow, refutes it. A
    hull point is needed only if no view that sees it has a confirmed depth there and no measured point is near.

    Args:
        points: Points on the hull, m. [N, 3].
        hull: Visual hull of the object.
        cloud: Measured points, and where each view has a confirmed depth.
        spacing: Distance of neighbours in `points`, m.
    """
    measured = np.zeros(len(points), np.int32)
    for view, confirmed in zip(cloud.views, cloud.confirmed, strict=True):
        camera = view.camera
        lattice = camera.scaled(confirmed.shape[1] / camera.width)
        front = mesh_depth(hull.mesh.vertices, hull.mesh.faces, lattice, view.cam_from_table)
        # Gaps of a few pixels between confirmed depths lie on the same surface, so they count as confirmed.
        closed = ndimage.binary_closing(confirmed, iterations=2)
        local = points @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3]
        index = np.floor(np.nan_to_num(lattice.project(local), nan=-1)).astype(int)
        valid = (index >= 0).all(axis=1) & (index[:, 0] < confirmed.shape[1]) & (index[:, 1] < confirmed.shape[0])
        columns, rows = index[valid, 0], index[valid, 1]
        visible = local[valid, 2] < front[rows, columns] + 2 * hull.grid.spacing
        measured[np.flatnonzero(valid)[visible & closed[rows, columns]]] += 1
    free = measured < 2
    if len(cloud.points):
        free &= cKDTree(cloud.points).query(points, distance_upper_bound=2.5 * spacing)[0] > 2.5 * spacing
    return free


def bottom_samples(hull: Hull, spacing: float) -> tuple[Array, Array]:
    """Points on the object's footprint, and their normals, which point down. [N, 3], [N, 3]."""
    layer = int(np.argmin(np.abs(hull.grid.axis(2))))
    step = max(1, round(spacing / hull.grid.spacing))
    foot = hull.field[:, :, layer + 1] > 0
    index = np.argwhere(foot)
    index = index[(index % step == 0).all(axis=1)]
    points = np.c_[hull.grid.origin[:2] + hull.grid.spacing * index, np.zeros(len(index))]
    return points, np.tile([0.0, 0.0, -1.0], (len(points), 1))


def poisson(points: Array, normals: Array, depth: int) -> Mesh:
    """Screened Poisson surface of oriented points, on one thread: with several, the order of its sums changes from run to run.

    Args:
        points: Points, m. [N, 3].
        normals: Their outward normals. [N, 3].
        depth: Depth of the octree.

    Source: Kazhdan, Hoppe, ACM TOG 32(3), 2013 (open3d's build).
    """
    open3d = import_open3d()
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.normals = open3d.utility.Vector3dVector(normals)
    surface, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=depth, scale=1.25, linear_fit=False, n_threads=1
    )
    return Mesh(np.asarray(surface.vertices).copy(), np.asarray(surface.triangles).astype(np.int64))


def trimmed(hull: Hull, cloud: DepthCloud, views: Sequence[View]) -> Hull:
    """Cut off the far ends of the viewing cones from the hull of an object that was seen from one side only.

    The unseen side is unknown; the trimmed hull is as deep as it is wide, and no higher than the measured points.

    Args:
        hull: Visual hull of the object.
        cloud: Measured points.
        views: Views that saw it.

    Returns:
        The trimmed hull; `hull` itself where nothing would be left.
    """
    middle = np.median(cloud.points, axis=0)
    ahead = np.mean([view.centre for view in views], axis=0)[:2] - middle[:2]
    ahead /= np.linalg.norm(ahead)
    across = np.array([-ahead[1], ahead[0]])
    left, right = np.percentile(cloud.points[:, :2] @ across, [1, 99])
    front = np.percentile(cloud.points[:, :2] @ ahead, 99)
    radius = 0.5 * (right - left)
    centre = 0.5 * (left + right) * across + (front - radius) * ahead
    top = np.percentile(cloud.points[:, 2], 99.5) + 0.02 * hull.size
    x, y, z = (hull.grid.axis(index) for index in range(3))
    limit = 1.05 * radius - np.hypot(x[:, None] - centre[0], y[None, :] - centre[1])
    solid = np.minimum(np.minimum(hull.uncut, limit[:, :, None]), (top - z)[None, None, :]).astype(np.float32)
    field = np.minimum(solid, z[None, None, :]).astype(np.float32)
    mesh = mesh_of_field(hull.grid, largest_component(field))
    return hull if mesh is None else Hull(hull.grid, field, solid, mesh)


def measured_wall(grid: Grid, cloud: DepthCloud, hull: Hull) -> Array:
    """Signed distance of a thin wall under the measured points that face upward, even where the outlines leave no room for it.

    Masks that lose the dark side of a bowl in a few photos cut holes through its hull, although its inside was measured there.
    Points right above the table do not count, because a mask that contains a part of the table yields such points, too.

    Args:
        grid: Grid of the result.
        cloud: Confirmed depth.
        hull: Visual hull.

    Returns:
        Positive within the wall, m; very low where no measured point is near. [nx, ny, nz] float32.
    """
    out = np.full(int(np.prod(grid.shape)), -1e9, np.float32)
    thick, clear, height = _WALL * hull.size, _CLEAR * hull.size, cloud.points[:, 2]
    floor = (height > clear) & (height < hull.mesh.vertices[:, 2].max() - clear) & (cloud.normals[:, 2] > _FLOOR)
    # Chance matches, on speckled clay for instance, would grow a wart. Photos from outside see the vessel's side through them.
    floor[floor] = ~seen_through(cloud.points[floor], cloud, hull.size)
    # A lone point that faces upward, which is an error of depth on a side, would grow a wart as well.
    around = 2.0 * thick
    every, facing = (cKDTree(cloud.points[part]) for part in (np.ones(len(floor), bool), floor))
    near_all = every.query_ball_point(cloud.points, around, return_length=True)
    near_floor = facing.query_ball_point(cloud.points, around, return_length=True) if floor.any() else np.zeros(len(floor))
    floor &= (near_floor > _MOSTLY * near_all) & (near_floor >= _PATCH)
    if floor.any():
        points, normals, places = cloud.points[floor], cloud.normals[floor], grid.points()
        found = cKDTree(points).query(places, distance_upper_bound=thick)
        distance, nearest = np.asarray(found[0]), np.asarray(found[1])
        near = np.flatnonzero(np.isfinite(distance))
        behind = ((points[nearest[near]] - places[near]) * normals[nearest[near]]).sum(1)
        # The wall starts half a cell deeper than measured, so that it adds nothing where the surface is there already.
        out[near] = np.minimum(behind - 0.5 * grid.spacing, thick - distance[near])
    return out.reshape(grid.shape)


def fuse(
    hull: Hull, cloud: DepthCloud, views: Sequence[View], settings: MeshSettings, *, narrow: bool, seed: int
) -> tuple[Grid, Array, dict[str, Any]]:
    """Fuse depth, hull and table into the signed distance of a solid object.

    Args:
        hull: Visual hull.
        cloud: Confirmed depth.
        views: The views, at any image size.
        settings: See `MeshSettings`.
        narrow: The views show one side only.
        seed: Seed of the hull's samples.

    Returns:
        Grid, signed distance (positive inside, cut at the table) [nx, ny, nz], and figures: points from depth and hull, the
        hull's share of the surface, and its share of what faces upward (`open_share`).
    """
    if narrow and len(cloud.points):
        hull = trimmed(hull, cloud, views)
    spacing = 0.009 * hull.size
    samples, normals = surface_samples(hull.mesh, spacing, seed)
    side = samples[:, 2] > 0.5 * hull.grid.spacing
    samples, normals = samples[side], normals[side]
    needed = unexplained(samples, hull, cloud, spacing)
    foot, down = bottom_samples(hull, spacing)
    points = np.concatenate([cloud.points, samples[needed], foot])
    directions = np.concatenate([cloud.normals, normals[needed], down])
    figures = {"depth_points": len(cloud.points), "hull_points": int(needed.sum()), "hull_share": float(needed.mean())}
    upward = normals[:, 2] > 0.5
    figures["open_share"] = float(needed[upward].mean()) if upward.sum() > 0.02 * len(normals) else 0.0
    surface = poisson(points, directions, settings.poisson_depth)
    low = np.array([*hull.mesh.vertices.min(0)[:2], 0.0])
    high = hull.mesh.vertices.max(0)
    step = float((high - low).max()) / settings.solid_voxels
    low, high = low - 3 * step, high + 3 * step
    grid = Grid.covering(np.array([low[0], low[1], -2 * step]), high, step)
    field = signed_field(surface, grid)
    # A Poisson surface may bulge where it has no points, but nothing can lie beyond the hull, up to the hull's own error.
    index = (grid.points() - hull.grid.origin) / hull.grid.spacing
    limit = ndimage.map_coordinates(hull.uncut, index.T, order=1, mode="nearest").reshape(grid.shape)
    field = np.minimum(field, limit + 0.012 * hull.size)
    # Where depth was confirmed there is a surface, even if masks that lost a part of the object cut it away.
    field = np.maximum(field, measured_wall(grid, cloud, hull))
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
        # A high power lets the most frontal photos dominate; an unweighted mean would blur the texture.
        gain = np.where(seen, np.maximum(cosine, 0) ** 6, 0.0)
        total += gain[:, None] * image[rows, columns]
        weight += gain
    colours = total / weight[:, None]
    seen = weight > 1e-6
    if seen.any() and not seen.all():
        colours[~seen] = colours[seen][cKDTree(mesh.vertices[seen]).query(mesh.vertices[~seen])[1]]
    return colours.astype(np.float32)
