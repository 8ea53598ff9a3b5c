"""Depth maps of an object's photos, and the points that several of these maps confirm."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy import ndimage

from gsbridge.cameras import Camera, View, Views
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.geometry import Array
from gsbridge.images import read_image_u8
from gsbridge.logs import ProgressLog
from gsbridge.mesh.hull import Hull
from gsbridge.mesh.stereo import confirm, patch_match
from gsbridge.photogrammetry.carving import mesh_depth

_HYPOTHESES = 24
_DEEP_HYPOTHESES = 40
_TABLE_HYPOTHESES = 3
_DEEP_MARGIN = 0.1
"""How much better the matches of the second search, deep into the object, must be: that search is wider, so that more of its
matches are chance."""
_UPWARD = 0.65
"""Least upward part of a first normal (half way between the hull's and the direction to the viewer) where the object may be
open: lids pass, walls do not."""
_SURE = 0.8
"""Correlation of the first search from which on no second surface is searched behind the first."""
_PASSES = 3
_TEXTURE = 0.008
"""Patches with a smaller standard deviation (0..1) show sensor noise rather than the surface."""
_THROUGH, _THROUGH_VIEWS = 0.02, 3
"""A point is an error if this many views measured a surface that far behind it, as a share of the object's size."""
_TOLERANCE = 0.006
"""Two depths agree within this share of the depth (2.4 mm at 0.4 m); the average then removes most of the difference."""


@dataclass(frozen=True)
class DepthCloud:
    """Points on the object's surface.

    Args:
        points: Measured points. [N, 3].
        normals: Unit, outward. [N, 3].
        confirmed: Per view, whether a lattice pixel has a confirmed depth. [h, w] bool each.
        views: The views at the lattice's size, whose pixels are the lattice pixels.
        tried: Number of lattice pixels on the object, over all views.
        depths: Per view, confirmed depth along camera z, 0 where there is none. [h, w] each.
    """

    points: Array
    normals: Array
    confirmed: tuple[Array, ...]
    views: tuple[View, ...]
    tried: int
    depths: tuple[Array, ...] = ()


@dataclass(frozen=True)
class _Photo:
    """One photo at working size, cut to the object.

    Args:
        view: Its view.
        grey: Grey picture, 0..1. [H, W] float32.
        mask: Pixels that patches may use. [H, W] bool.
        sought: Pixels whose depth is wanted. [H, W] bool.
    """

    view: View
    grey: Array
    mask: Array
    sought: Array


def rank_sources(views: Sequence[View], target: Array, count: int, best_deg: float = 12.0) -> list[list[int]]:
    """Choose the views to compare each view with: about `best_deg` apart as seen from `target`, and spread to both sides.

    Args:
        views: Posed views.
        target: Middle of what is looked at, m. [3].
        count: Views wanted.
        best_deg: Wanted angle between the lines of sight, degrees: at smaller ones depth is measured badly, at larger ones
            photos look different.

    Returns:
        Indices, best first, for each view; views more than 60 degrees apart are not taken.
    """
    rays = np.stack([target - view.centre for view in views])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(rays @ rays.T, -1, 1)))
    out = []
    for index in range(len(views)):
        cost = np.abs(np.log(np.maximum(angles[index], 0.5) / best_deg))
        cost[index] = np.inf
        cost[angles[index] > 60.0] = np.inf
        chosen: list[int] = []
        for _ in range(min(count, int(np.isfinite(cost).sum()))):
            pick = int(np.argmin(cost))
            chosen.append(pick)
            # A view beside one that is already taken sees nearly the same and has the same occlusions.
            cost = cost + 0.6 * np.exp(-((angles[pick] / best_deg) ** 2))
            cost[pick] = np.inf
        out.append(chosen)
    return out


def _working_photos(
    views: Views, masks: Sequence[Array], own: Sequence[Array] | None, settings: MeshSettings, scale_to: float
) -> list[_Photo]:
    """Shrink photos to the working width and crop them to the mask's surroundings, whose size is a multiple of the stride.

    Args:
        views, masks, own, settings: See `depth_cloud`.
        scale_to: Border round the mask, as a share of its longer side.
    """
    stride = settings.stride
    photos = []
    for index, (view, mask) in enumerate(zip(views, masks, strict=True)):
        camera = view.camera.scaled(min(1.0, settings.image_width / view.camera.width))
        size = (camera.width, camera.height)
        grey = cv2.cvtColor(read_image_u8(views.path(view)), cv2.COLOR_RGB2GRAY).astype(np.float32) / 255.0
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        small = cv2.resize(mask, size, interpolation=cv2.INTER_AREA) > 0.5
        sought = small
        if own is not None:
            sought = _off_outline(small, cv2.resize(own[index], size, interpolation=cv2.INTER_AREA) > 0.5, settings.window)
        rows, columns = np.nonzero(small)
        if len(rows) == 0:
            rows, columns = np.array([0]), np.array([0])
        border = int(scale_to * max(np.ptp(rows), np.ptp(columns))) + 4 * stride
        left, top = max(0, columns.min() - border), max(0, rows.min() - border)
        right, bottom = min(camera.width, columns.max() + 1 + border), min(camera.height, rows.max() + 1 + border)
        w, h = (right - left) // stride * stride, (bottom - top) // stride * stride
        camera = camera.cropped(int(left), int(top), int(w), int(h))
        part = (slice(int(top), int(top + h)), slice(int(left), int(left + w)))
        layers = (np.ascontiguousarray(layer[part]) for layer in (grey, small, sought))
        photos.append(_Photo(replace(view, camera=camera), *layers))
    return photos


def _off_outline(mask: Array, own: Array, window: int) -> Array:
    """Pixels of a mask without those beside the object whose patches contain a part of it, and so its depth. [H, W] bool.

    Args:
        mask: The object with its surroundings. [H, W] bool.
        own: The object alone. [H, W] bool.
        window: Radius of the patches, px.
    """
    side = 2 * window + 1
    return mask & (own | (cv2.dilate(own.astype(np.uint8), np.ones((side, side), np.uint8)) == 0))


def _relative(photo: View, source: View) -> tuple[Array, Array]:
    """Homography from the photo's pixels to the source's at infinite depth, and the shift per inverse depth. [3, 3], [3]."""
    pose = source.cam_from_table @ np.linalg.inv(photo.cam_from_table)
    return (
        source.camera.intrinsics @ pose[:3, :3] @ np.linalg.inv(photo.camera.intrinsics),
        source.camera.intrinsics @ pose[:3, 3],
    )


def _lattice_camera(camera: Camera, stride: int) -> Camera:
    """Camera whose pixel centres are exactly the lattice pixels' centres."""
    shift = (stride // 2 + 0.5) / stride - 0.5
    width, height = camera.width // stride, camera.height // stride
    return Camera(width, height, camera.fx / stride, camera.fy / stride, camera.cx / stride - shift, camera.cy / stride - shift)


def normals_of_depth(depth: Array, camera: Camera) -> Array:
    """Normals towards the camera from differences of a depth map; (0, 0, -1) beside a gap. [h, w] -> [h, w, 3] float32."""
    points = camera.pixel_rays() * np.where(np.isfinite(depth), depth, np.nan)[..., None]
    normals = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = normals / length
    rays = camera.pixel_rays()
    normals = np.where((normals * rays).sum(-1, keepdims=True) > 0, -normals, normals)
    # The hull is rough, so a normal half way to the direction of the viewer is a safer start.
    normals = normals - rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.where(np.isfinite(normals).all(-1, keepdims=True), normals, np.array([0.0, 0.0, -1.0])).astype(np.float32)


def enters_from_above(front: Array, normals: Array, view: View) -> Array:
    """Lines of sight that enter a hull through a possible opening: through its upper side, not through its walls. [h, w] bool.

    Args:
        front: Depth of the hull, m; not finite beside it. [h, w].
        normals: See `normals_of_depth`. [h, w, 3].
        view: The view that sees it.
    """
    return np.isfinite(front) & (normals @ view.cam_from_table[:3, 2] > _UPWARD)


def depth_cloud(
    views: Views,
    masks: Sequence[Array],
    hull: Hull,
    settings: MeshSettings,
    seed: int,
    threads: int,
    *,
    own: Sequence[Array] | None = None,
) -> DepthCloud:
    """Measure points on the object on which several depth maps agree.

    Args:
        views, masks: Photos and masks. [H, W] each.
        hull: Visual hull; depths are searched from a little in front of it inwards, and not below the table.
        settings: See `MeshSettings`.
        seed: Random seed.
        threads: Threads to use.
        own: Masks of the object alone, given if `masks` hold its surroundings, too. [H, W] each. Then a depth counts only if it
            matches clearly better than the table's: a printed grid also matches itself one line further, which all photos of
            an even orbit see at the same height. Pixels beside the object whose patches contain its outline are left out,
            because they take on the object's depth. The second search, deep in the hull, is left out, too.
    """
    stride = settings.stride
    photos = _working_photos(views, masks, own, settings, 0.5)
    middle = 0.5 * (hull.mesh.vertices.min(0) + hull.mesh.vertices.max(0))
    sources = rank_sources([photo.view for photo in photos], middle, settings.sources)
    lattice = [_lattice_camera(photo.view.camera, stride) for photo in photos]
    progress = ProgressLog(len(photos), "depth maps")

    def work(index: int) -> tuple[Array, Array]:
        photo, camera = photos[index], lattice[index]
        front = mesh_depth(hull.mesh.vertices, hull.mesh.faces, camera, photo.view.cam_from_table)
        normals = normals_of_depth(front, camera)
        inside = photo.sought[stride // 2 :: stride, stride // 2 :: stride][: camera.height, : camera.width]
        # Depth at which a line of sight meets the table: nothing lies beyond it.
        pose = photo.view.cam_from_table
        fall = camera.pixel_rays() @ pose[:3, 2]
        table = np.where(fall < -1e-6, photo.view.centre[2] / np.maximum(-fall, 1e-6), np.inf)
        near = np.where(inside, front - 0.04 * hull.size, np.inf).astype(np.float32)
        far = np.minimum(front + 0.35 * hull.size, table).astype(np.float32)
        near[~(far > near)] = np.inf
        chosen = sources[index]
        if not chosen:
            return np.zeros(near.shape, np.float32), near
        largest = np.array([photos[s].grey.shape for s in chosen]).max(0)
        images = np.zeros((len(chosen), *largest), np.float32)
        for slot, s in enumerate(chosen):
            images[slot, : photos[s].grey.shape[0], : photos[s].grey.shape[1]] = photos[s].grey
        pairs = [_relative(photo.view, photos[s].view) for s in chosen]
        k = photo.view.camera
        maps, shifts = np.stack([pair[0] for pair in pairs]), np.stack([pair[1] for pair in pairs])

        def search(first: Array, last: Array, hypotheses: int, least: float, normals: Array = normals) -> tuple[Array, Array]:
            depth, _, score = patch_match(
                photo.grey,
                photo.mask,
                images,
                maps,
                shifts,
                np.array([k.fx, k.fy, k.cx, k.cy]),
                first,
                last,
                normals,
                settings.window,
                stride,
                hypotheses,
                _PASSES,
                _TEXTURE,
                seed + index,
            )
            depth[score < least] = 0.0
            return depth, score

        depth, score = search(near, far, _HYPOTHESES, settings.min_score)
        # A line of sight that enters the hull from above may look into the object, so the search goes on to the hull's far end.
        end = np.minimum(float((hull.mesh.vertices @ pose[2, :3] + pose[2, 3]).max()), table).astype(np.float32)
        opened = enters_from_above(near, normals, photo.view) & (end > far)
        if opened.any():
            # Matches at the end of the first search's range are unreliable: the surface may lie just beyond it.
            depth[opened & (depth > far - 0.03 * hull.size)] = 0.0
        if opened.any() and own is None:
            deeper = opened & ((score < _SURE) | (depth == 0))
            first = np.where(deeper, far - 0.06 * hull.size, np.inf).astype(np.float32)
            deep, deep_score = search(first, end, _DEEP_HYPOTHESES, settings.min_score + _DEEP_MARGIN)
            better = (deep > 0) & ((depth == 0) | (deep_score > score + _DEEP_MARGIN))
            depth = np.where(better, deep, depth)
            score = np.where(better, deep_score, score)
        if own is not None:
            lying = np.broadcast_to(pose[:3, 2], normals.shape).astype(np.float32)
            begin = np.where(np.isfinite(near), (1 - _TOLERANCE) * table, np.inf).astype(np.float32)
            end = ((1 + _TOLERANCE) * table).astype(np.float32)
            plain = search(begin, end, _TABLE_HYPOTHESES, settings.min_score, lying)[1]
            depth[score < plain + _DEEP_MARGIN] = 0.0
        return depth, near

    depths, tried = [], 0
    with ThreadPoolExecutor(threads) as pool:
        for depth, near in pool.map(work, range(len(photos))):
            depths.append(depth)
            tried += int(np.isfinite(near).sum())
            progress.update()
    return _merge(photos, lattice, depths, middle, settings, tried)


def _merge(
    photos: Sequence[_Photo],
    lattice: Sequence[Camera],
    depths: Sequence[Array],
    middle: Array,
    settings: MeshSettings,
    tried: int,
) -> DepthCloud:
    """Keep the depths that other maps confirm, and turn them into points with normals."""
    stride = settings.stride
    neighbours = rank_sources([photo.view for photo in photos], middle, 2 * settings.sources)
    points, confirmed, kept_depths = [], [], []
    for index, (photo, camera, depth) in enumerate(zip(photos, lattice, depths, strict=True)):
        pose = photo.view.cam_from_table
        local = camera.pixel_rays() * depth[..., None]
        world = (local - pose[:3, 3]) @ pose[:3, :3]
        chosen = [s for s in neighbours[index] if depths[s].any()]
        if not chosen:
            confirmed.append(np.zeros(depth.shape, bool))
            kept_depths.append(np.zeros(depth.shape, np.float32))
            continue
        largest = np.array([depths[s].shape for s in chosen]).max(0)
        others = np.zeros((len(chosen), *largest), np.float32)
        for slot, s in enumerate(chosen):
            others[slot, : depths[s].shape[0], : depths[s].shape[1]] = depths[s]
        poses = np.stack([photos[s].view.cam_from_table for s in chosen])
        cameras = [photos[s].view.camera for s in chosen]
        intrinsics = np.array([[c.fx, c.fy, c.cx, c.cy] for c in cameras])
        averaged, agree = confirm(world, depth, others, poses, intrinsics, stride, _TOLERANCE, settings.min_agree)
        confirmed.append(agree > 0)
        kept_depths.append(np.where(agree > 0, depth, 0.0).astype(np.float32))
        found = averaged[agree > 0]
        points.append(np.c_[found, np.broadcast_to(photo.view.centre, found.shape)])
    views = tuple(replace(photo.view, camera=camera) for photo, camera in zip(photos, lattice, strict=True))
    cloud = np.concatenate(points) if points else np.zeros((0, 6))
    kept, normals = _oriented(cloud)
    return DepthCloud(kept, normals, tuple(confirmed), views, tried, tuple(kept_depths))


def _oriented(cloud: Array) -> tuple[Array, Array]:
    """Thin out points (each with its camera's centre), drop lone ones, find normals to the cameras. [N, 6] -> [M, 3] x 2."""
    if len(cloud) < 50:
        return np.zeros((0, 3)), np.zeros((0, 3))
    from scipy.spatial import cKDTree

    points, centres = cloud[:, :3], cloud[:, 3:]
    cell = 0.006 * float((np.percentile(points, 99, axis=0) - np.percentile(points, 1, axis=0)).max())
    _, inverse, counts = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.ravel()
    points = np.stack([np.bincount(inverse, points[:, axis]) / counts for axis in range(3)], axis=1)
    centres = np.stack([np.bincount(inverse, centres[:, axis]) / counts for axis in range(3)], axis=1)
    size = min(24, len(points))
    distances, neighbours = cKDTree(points).query(points, k=size)
    reach = np.asarray(distances)[:, min(8, size - 1)]
    good = reach < 3.0 * np.median(reach)
    local = points[neighbours] - points[neighbours].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", local, local))[1][:, :, 0]
    away = ((centres - points) * normals).sum(1) < 0
    normals[away] *= -1
    # Moving points most of the way to their neighbours' plane removes noise across the surface and keeps detail along it.
    offset = ((points - points[neighbours].mean(axis=1)) * normals).sum(1)
    return (points - 0.8 * offset[:, None] * normals)[good], normals[good]


def seen_through(points: Array, cloud: DepthCloud, size: float) -> Array:
    """Whether views measured a surface behind each point, so that the point cannot be there. [N, 3] -> [N] bool.

    Args:
        points: Points in the table frame, m. [N, 3].
        cloud: Confirmed depth.
        size: Longest side of the object, m.
    """
    count = np.zeros(len(points), int)
    for view, depth in zip(cloud.views, cloud.depths, strict=True):
        # The nearest depth round a pixel counts, or else the far side of an edge would prove the near side empty.
        nearest = ndimage.minimum_filter(np.where(depth > 0, depth, np.inf), size=3, mode="nearest")
        local = points @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3]
        index = np.floor(np.nan_to_num(view.camera.project(local), nan=-1)).astype(int)
        there = np.flatnonzero(((index >= 0) & (index < depth.shape[::-1])).all(axis=1))
        columns, rows = index[there].T
        behind = np.where(depth[rows, columns] > 0, nearest[rows, columns], 0.0)
        count[there] += behind > local[there, 2] + _THROUGH * size
    return count >= _THROUGH_VIEWS
