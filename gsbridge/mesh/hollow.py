"""Corrections to a visual hull: remove space that measured depth proves empty, and a top that no outline needs.

Outlines taken from one height leave a cone over an object that is open at the top, and no outline shows a cavity. Depth that
other views confirm shows both, because the space in front of a measured surface is empty.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from gsbridge.cameras import View
from gsbridge.geometry import Array
from gsbridge.kernels import njit
from gsbridge.mesh.depth import DepthCloud, enters_from_above, normals_of_depth
from gsbridge.mesh.hull import Hull
from gsbridge.mesh.repair import depth_inside
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.carving import largest_component, mesh_depth, mesh_of_field

_VIEWS = 3
"""Views that must see through a place before it counts as empty; otherwise a single wrong depth would drill a hole."""
_SLACK = 0.012
"""Least distance of an empty place from the measured surface behind it, as a share of the object's size."""
_GAP, _ALIKE, _AROUND = 0.06, 0.05, 4
"""Gaps up to about `_GAP` wide in the depth of an opening are closed where the depths around differ by less than `_ALIKE` (both
as shares of the object's size) and at least `_AROUND` of the 5 x 5 pixels around have a depth."""
_WORTH = 0.01
"""If depth would remove less than this share of the hull's volume, that is noise of the depth, and the hull stays as it is."""
_LOWER = 0.03
"""The top is lowered only if that takes off at least this share of the hull's size; less is the outlines' noise."""
_MEASURED = 0.2
"""The top stays, as a patterned dome does, if depth was measured in it along more than this share of the lines of sight."""
_NEAR = 0.035
"""Surface nearer than this to a measured point, as a share of the object's size, counts as measured."""
_AHEAD, _BEYOND, _INNER = 0.06, 0.02, 0.05
"""A surface faces into the hull if the point `_AHEAD` in front of it lies more than `_BEYOND` deep in the hull, both as shares
of the object's size. If less than `_INNER` of the whole surface does so, it is a dent and no hollow."""
_SPECK = 0.001
"""Share of the whole surface that is too small to be reported."""
_OUTLINE_WIDTH = 320
"""Masks are shrunk to this width for the height that the outlines need, px."""


@njit(nogil=True)
def _free_slab(origin, spacing, begin, end, solid, depths, sizes, projections, wanted, out):  # type: ignore[no-untyped-def]
    """Distance of points in x layers `begin`..`end` in front of measured surfaces: the `wanted`-th largest over all views."""
    largest = np.empty(wanted, np.float32)
    for i in range(begin, end):
        x = origin[0] + spacing * i
        for j in range(out.shape[1]):
            y = origin[1] + spacing * j
            for k in range(out.shape[2]):
                if not solid[i, j, k]:
                    continue
                z = origin[2] + spacing * k
                largest[:] = -1e9
                for v in range(depths.shape[0]):
                    p = projections[v]
                    depth = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
                    if depth <= 1e-6:
                        continue
                    c = int(np.floor((p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / depth))
                    r = int(np.floor((p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / depth))
                    if c < 0 or r < 0 or c >= sizes[v, 0] or r >= sizes[v, 1]:
                        continue
                    measured = depths[v, r, c]
                    if measured <= 0:
                        continue
                    value = np.float32(measured - depth)
                    slot = wanted - 1
                    if value <= largest[slot]:
                        continue
                    while slot > 0 and largest[slot - 1] < value:
                        largest[slot] = largest[slot - 1]
                        slot -= 1
                    largest[slot] = value
                out[i, j, k] = largest[wanted - 1]


def free_space(hull: Hull, views: Sequence[View], depths: Sequence[Array], threads: int) -> Array:
    """Distance of each place within a hull from the measured surface behind it.

    Args:
        hull: Visual hull.
        views: Views at the size of their depth maps.
        depths: Confirmed depth along camera z, m, 0 where there is none. [h, w] each.
        threads: Threads to use.

    Returns:
        The distance that at least `_VIEWS` views confirm, positive in empty space, m; very low where fewer views measured
        anything, and outside the hull. [nx, ny, nz] float32.
    """
    out = np.full(hull.grid.shape, -1e9, np.float32)
    if len(depths) < _VIEWS:
        return out
    sizes = np.array([depth.shape[::-1] for depth in depths])
    maps = np.zeros((len(depths), sizes[:, 1].max(), sizes[:, 0].max()), np.float32)
    for item, depth in zip(maps, depths, strict=True):
        # The nearest depth round a pixel counts, or else the far side of an edge would prove the near side empty.
        near = np.where(depth > 0, depth, np.inf)
        near = ndimage.minimum_filter(near, size=3, mode="nearest")
        item[: depth.shape[0], : depth.shape[1]] = np.where((depth > 0) & np.isfinite(near), near, 0.0)
    projections = np.stack([view.camera.intrinsics @ view.cam_from_table[:3] for view in views])
    solid = hull.field > 0
    layers = np.linspace(0, hull.grid.shape[0], 4 * threads + 1).astype(int)
    fixed = (solid, maps, sizes, projections, _VIEWS, out)
    with ThreadPoolExecutor(threads) as pool:
        jobs = [
            pool.submit(_free_slab, hull.grid.origin, hull.grid.spacing, a, b, *fixed)
            for a, b in zip(layers[:-1], layers[1:], strict=True)
            if b > a
        ]
        for job in jobs:
            job.result()
    return out


def _without_gaps(hull: Hull, view: View, depth: Array) -> Array:
    """Close gaps in a view's depth where it looks into an opening of the hull from above. [h, w] -> [h, w] float32.

    In compressed photos and on dark walls, depth is confirmed in speckles only. The speckles tell where the wall is, but the
    lines of sight of three views through one place seldom all end on speckles, so that heaps that no photo shows would remain
    in front of the wall. Lines of sight through the hull's sides keep their gaps: an unmeasured gap there may be a rod in front
    of a wall.
    """
    camera, pose = view.camera, view.cam_from_table
    front = mesh_depth(hull.mesh.vertices, hull.mesh.faces, camera, pose)
    open_to = enters_from_above(front, normals_of_depth(front, camera), view)
    middle = 0.5 * (hull.mesh.vertices.min(0) + hull.mesh.vertices.max(0))
    pixels = camera.fx * hull.size / max(float(pose[2, :3] @ middle + pose[2, 3]), 1e-6)
    out = depth.astype(np.float32)
    brush = np.ones((5, 5), np.uint8)
    # Each round closes gaps by two pixels from their edges.
    for _ in range(max(1, round(0.5 * _GAP * pixels))):
        known = out > 0
        count = cv2.boxFilter(known.astype(np.float32), -1, (5, 5), normalize=False, borderType=cv2.BORDER_CONSTANT)
        total = cv2.boxFilter(out, -1, (5, 5), normalize=False, borderType=cv2.BORDER_CONSTANT)
        spread = cv2.dilate(out, brush) - cv2.erode(np.where(known, out, np.float32(1e9)), brush)
        new = open_to & ~known & (count > _AROUND - 0.5) & (spread < _ALIKE * hull.size)
        if not new.any():
            break
        out[new] = total[new] / count[new]
    return out


def needed_height(hull: Hull, views: Sequence[View], masks: Sequence[Array]) -> float:
    """Height up to which the outlines need the hull: cut off there, it covers nearly all masks as well as the whole hull does.

    Outlines from one height leave a cone over a flat or open top that no picture needs. A thin tip that some pictures do show
    stays.

    Args:
        hull: Visual hull.
        views: Posed views.
        masks: Their masks, 0..1. [H, W] each.
    """
    small = []
    for view, mask in zip(views, masks, strict=True):
        camera = view.camera.scaled(min(1.0, _OUTLINE_WIDTH / view.camera.width))
        inside = cv2.resize(mask, (camera.width, camera.height), interpolation=cv2.INTER_AREA) > 0.5
        if inside.any():
            covered = np.isfinite(mesh_depth(hull.mesh.vertices, hull.mesh.faces, camera, view.cam_from_table))
            small.append((camera, view.cam_from_table, inside & covered))
    # Outlines are accurate to about two pixels.
    brush = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    middle = hull.mesh.vertices.mean(0)
    blur = []
    for camera, pose, _ in small:
        ray = pose[:3, :3] @ middle + pose[:3, 3]
        level = np.sqrt(1 - (pose[2, 2]) ** 2)
        blur.append(2.0 * ray[2] / (camera.fy * max(level, 0.2)))

    def enough(height: float) -> bool:
        vertices = hull.mesh.vertices.copy()
        vertices[:, 2] = np.minimum(vertices[:, 2], height)
        missed = 0
        for camera, pose, needed in small:
            left = np.isfinite(mesh_depth(vertices, hull.mesh.faces, camera, pose)).astype(np.uint8)
            missed += int((needed & (cv2.dilate(left, brush) == 0)).sum()) > 3
        return missed <= 0.1 * len(small)

    top = float(hull.mesh.vertices[:, 2].max())
    low, high = 0.0, top
    while high - low > 0.005 * top:
        half = 0.5 * (low + high)
        low, high = (low, half) if enough(half) else (half, high)
    # Pixels within two pixels of the outline never count as missed, so that the search ends that much too low.
    return min(top, high + float(np.median(blur)))


def lowered(hull: Hull, views: Sequence[View], masks: Sequence[Array], measure: Callable[[], DepthCloud]) -> Hull:
    """Cut off a hull's top if neither the outlines nor measured points need it; else return the same object.

    Matches on a top that does not exist are accidental and hide the surface below, so the top is cut off before the final depth
    search.

    Args:
        hull: Visual hull.
        views: The views, at any image size.
        masks: Their masks, 0..1. [H, W] each.
        measure: Measures rough depth from this hull inwards; called only if the outlines do not need the top.
    """
    top = float(hull.mesh.vertices[:, 2].max())
    height = needed_height(hull, views, masks)
    if height > top - _LOWER * hull.size or _measured_above(hull, measure(), height) > _MEASURED:
        return hull
    return _rebuilt(hull, np.minimum(hull.uncut, (height - hull.grid.axis(2)[None, None, :]).astype(np.float32)))


def _measured_above(hull: Hull, cloud: DepthCloud, height: float) -> float:
    """Among the lines of sight that enter a hull above a height, the share with a measured depth above that height."""
    slack = _LOWER * hull.size
    entered = ended = 0
    for view, depth in zip(cloud.views, cloud.depths, strict=True):
        pose = view.cam_from_table
        front = mesh_depth(hull.mesh.vertices, hull.mesh.faces, view.camera, pose)
        # Height at depth d along a line of sight: the camera's height and d times the fall of its ray.
        fall = view.camera.pixel_rays() @ pose[:3, 2]
        above = np.isfinite(front) & (view.centre[2] + np.where(np.isfinite(front), front, 0.0) * fall > height + slack)
        entered += int(above.sum())
        ended += int((above & (depth > 0) & (view.centre[2] + depth * fall > height + slack)).sum())
    return ended / max(entered, 1)


def _rebuilt(hull: Hull, uncut: Array) -> Hull:
    """The hull with another field; the old hull if the new field is empty."""
    field = largest_component(np.minimum(uncut, hull.grid.axis(2).astype(np.float32)[None, None, :]))
    mesh = mesh_of_field(hull.grid, field)
    return hull if mesh is None else replace(hull, field=field, uncut=uncut, mesh=mesh)


def carved(hull: Hull, cloud: DepthCloud, threads: int) -> tuple[Hull, float]:
    """Remove from a hull the space that depth proves empty.

    Args:
        hull: Visual hull.
        cloud: Confirmed depth.
        threads: Threads to use.

    Returns:
        The hull and the share of its volume that was removed; the same object and 0 if that share is no more than noise.
    """
    closed = [_without_gaps(hull, view, depth) for view, depth in zip(cloud.views, cloud.depths, strict=True)]
    free = free_space(hull, cloud.views, closed, threads)
    share = float((free > _SLACK * hull.size).sum()) / max(float((hull.field > 0).sum()), 1.0)
    if share < _WORTH:
        return hull, 0.0
    left = np.where(free > -1e8, _SLACK * hull.size - free, np.inf)
    # Depth maps have ragged borders, so steps finer than two voxels are noise.
    left = ndimage.gaussian_filter(np.clip(left, -4 * hull.grid.spacing, 4 * hull.grid.spacing), 0.8)
    return _rebuilt(hull, np.minimum(hull.uncut, left).astype(np.float32)), share


def guessed_share(mesh: Mesh, points: Array) -> float:
    """Share of the upward surface near which nothing was measured, as on the bottom of a deep cup.

    Lines of sight that end on the far wall of a cup prove the space in front of the wall empty, but leave a heap on the bottom.

    Args:
        mesh: An object, standing on z = 0.
        points: Measured points, m. [N, 3].
    """
    size = float(np.ptp(mesh.vertices, axis=0).max())
    return _far_share(mesh, points, (mesh.normals()[:, 2] > 0.5) & (mesh.corners().mean(1)[:, 2] > _LOWER * size))


def guessed_inside(mesh: Mesh, points: Array, hull: Mesh, centres: Array) -> tuple[float, float]:
    """Of the surface that no outline can have shaped, the share that is far from all measured points, and how far it is.

    Such a surface faces into the hull, as the inner wall of a pot does: the space in front of it lies inside all outlines, and
    only depth can have emptied it. Surface that faces away from every camera is left out: the unseen side of a narrow capture
    and the underside of an apple face into the hull, too, but are no openings.

    Args:
        mesh: An object, standing on z = 0.
        points: Measured points, m. [N, 3].
        hull: Its visual hull, before depth removed anything.
        centres: Places of the cameras, m. [V, 3].

    Returns:
        The share of that surface near which nothing was measured, 0..1; and a distance from all measured points, as a share of
        the object's size, which a part of that surface as large as a thousandth of the object's whole surface exceeds.
    """
    size = float(np.ptp(mesh.vertices, axis=0).max())
    middles = mesh.corners().mean(1)
    before = middles + _AHEAD * size * mesh.normals()
    faces_in = (depth_inside(hull, before) > _BEYOND * size) & _faces_any(mesh, centres)
    areas = mesh.areas()
    if float(areas[faces_in].sum()) < _INNER * float(areas.sum()):
        return 0.0, 0.0
    part = faces_in & (middles[:, 2] > _LOWER * size)
    if not part.any() or len(points) == 0:
        return _far_share(mesh, points, part), float(part.any())
    away = np.asarray(cKDTree(points).query(middles[part])[0]) / size
    order = np.argsort(-away)
    beyond = np.searchsorted(np.cumsum(areas[part][order]), _SPECK * float(areas.sum()))
    return _far_share(mesh, points, part), float(away[order[min(int(beyond), len(order) - 1)]])


def _faces_any(mesh: Mesh, centres: Array) -> Array:
    """Whether each face of a mesh is turned to any of the cameras, occluded or not. [V, 3] -> [F] bool."""
    normals, middles = mesh.normals(), mesh.corners().mean(1)
    # Only the largest n . c over the cameras is kept; n . (c - p) for all cameras at once would be [F, V].
    ahead = np.full(len(normals), -np.inf)
    for centre in centres:
        np.maximum(ahead, normals @ centre, out=ahead)
    return np.asarray(ahead > (normals * middles).sum(1))


def _far_share(mesh: Mesh, points: Array, part: Array) -> float:
    """Share of a part of a surface, by area, that is far from all measured points. [F] bool."""
    if not part.any():
        return 0.0
    if len(points) == 0:
        return 1.0
    size = float(np.ptp(mesh.vertices, axis=0).max())
    far = cKDTree(points).query(mesh.corners().mean(1)[part])[0] > _NEAR * size
    areas = mesh.areas()[part]
    return float(areas[far].sum() / areas.sum())
