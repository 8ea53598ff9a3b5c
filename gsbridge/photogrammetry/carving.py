"""Space carving: a solid from silhouettes, its surface, and the surface's depth in a view.

Instead of counting votes per voxel, every silhouette gives a signed distance to its outline; a voxel keeps a low quantile of
these distances over the views that see it. The quantile tolerates a few wrong silhouettes as a vote does, and its zero level
is a surface that is located far more finely than the voxels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage
from skimage.measure import marching_cubes

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.kernels import Real, njit
from gsbridge.meshes import Mesh

_COARSE = 4
"""The carving first runs on every 4th voxel in each direction; then only voxels near the surface are computed one by one."""


@dataclass(frozen=True)
class Grid:
    """A regular grid of sample points.

    Args:
        origin: First sample point, table frame. [3].
        spacing: Distance between neighbours along each axis.
        shape: Number of samples along x, y, z.
    """

    origin: Array
    spacing: float
    shape: tuple[int, int, int]

    @classmethod
    def covering(cls, low: Array, high: Array, spacing: float) -> Grid:
        """Smallest grid of this spacing that starts at `low` and reaches `high`.

        Args:
            low: First sample point, table frame. [3].
            high: Corner to reach, table frame. [3].
            spacing: Distance between neighbours along each axis, in the unit of the corners.
        """
        extent = np.asarray(high, dtype=np.float64) - np.asarray(low, dtype=np.float64)
        count = np.maximum(np.ceil(extent / spacing - 1e-9).astype(int) + 1, 2)
        return cls(np.asarray(low, dtype=np.float64), float(spacing), (int(count[0]), int(count[1]), int(count[2])))

    def axis(self, index: int) -> Array:
        """Sample positions along one axis. [shape[index]]."""
        return self.origin[index] + self.spacing * np.arange(self.shape[index])

    def points(self) -> Array:
        """All sample points, z fastest. [nx * ny * nz, 3]."""
        x, y, z = np.meshgrid(self.axis(0), self.axis(1), self.axis(2), indexing="ij")
        return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=-1)


@dataclass(frozen=True)
class Silhouette:
    """Signed distance to the outline of a mask, with the view it belongs to.

    Args:
        distances: Pixels to the outline, positive inside. [H, W] float32.
        camera: Pinhole of the mask.
        cam_from_table: Pose. [4, 4].
    """

    distances: Array
    camera: Camera
    cam_from_table: Array


def signed_distances(mask: Array) -> Array:
    """Distance of every pixel centre to the outline of `mask > 0.5`, px, positive inside. [H, W] -> [H, W] float32."""
    inside = (np.asarray(mask) > 0.5).astype(np.uint8)
    # cv2 measures to the nearest pixel centre on the other side; the outline is half a pixel nearer.
    within, beyond = _distances(inside), _distances(1 - inside)
    return np.where(inside > 0, within - 0.5, 0.5 - beyond).astype(np.float32)


def _distances(inside: Array) -> Array:
    """Distance of each pixel to the nearest zero, px. [H, W] uint8 -> [H, W] float32.

    The last bit of cv2's square roots depends on threads and on the image's place in memory. Squares of distances between
    pixels are whole numbers, so that rounding recovers them exactly, up to 1400 px.
    """
    found = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    squares = np.rint(np.square(found, dtype=np.float64))
    # If the image has no zero, cv2 returns a huge number, which is no distance.
    return np.where(found < 1e4, np.sqrt(squares), found).astype(np.float32)


@njit(nogil=True)
def _carve_slab(
    origin: Array,
    spacing: float,
    begin: int,
    end: int,
    wanted: Array,
    images: Array,
    sizes: Array,
    projections: Array,
    focals: Array,
    share: float,
    least: int,
    unseen: Real,
    out: Array,
) -> None:
    """Quantile of the signed distances for x layers `begin`..`end`; see `carve`. `projections` [V, 3, 4] map to pixels."""
    views = images.shape[0]
    # 1.0 - 0.9 is a little less than 0.1, and a tenth of ten views would otherwise be none.
    share += 1e-9
    keep = int(share * views) + 1
    lowest = np.empty(keep + 1, np.float32)
    for i in range(begin, end):
        x = origin[0] + spacing * i
        for j in range(out.shape[1]):
            y = origin[1] + spacing * j
            for k in range(out.shape[2]):
                if not wanted[i, j, k]:
                    continue
                z = origin[2] + spacing * k
                seen = 0
                held = 0
                for v in range(views):
                    p = projections[v]
                    depth = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
                    if depth <= 1e-6:
                        continue
                    u = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / depth - 0.5
                    w = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / depth - 0.5
                    if u < 0.0 or w < 0.0 or u >= sizes[v, 0] - 1 or w >= sizes[v, 1] - 1:
                        continue
                    seen += 1
                    c = int(u)
                    r = int(w)
                    fu = u - c
                    fw = w - r
                    image = images[v]
                    value = (image[r, c] * (1 - fu) + image[r, c + 1] * fu) * (1 - fw) + (
                        image[r + 1, c] * (1 - fu) + image[r + 1, c + 1] * fu
                    ) * fw
                    value = value * depth / focals[v]
                    if held < keep or value < lowest[held - 1]:
                        slot = held if held < keep else keep - 1
                        while slot > 0 and lowest[slot - 1] > value:
                            lowest[slot] = lowest[slot - 1]
                            slot -= 1
                        lowest[slot] = value
                        if held < keep:
                            held += 1
                if seen < least:
                    out[i, j, k] = unseen
                else:
                    out[i, j, k] = lowest[min(int(share * seen), held - 1)]


def carve(
    grid: Grid, silhouettes: Sequence[Silhouette], *, vote: float, min_views: int = 2, threads: int = 1, coarse: bool = True
) -> Array:
    """Signed distance of the visual hull, positive inside.

    Args:
        grid: Sample points.
        silhouettes: Outlines with their views.
        vote: Among the views that see a point, the share whose silhouettes must contain it, 0..1; `1` is the plain visual hull.
        min_views: Points seen by fewer views are outside.
        threads: Threads to use.
        coarse: Compute points far from the surface on a coarser grid, and interpolate.

    Returns:
        The quantile `1 - vote` of the signed distances of each point, in the unit of the poses. [nx, ny, nz] float32.
    """
    sizes = np.array([item.distances.shape[::-1] for item in silhouettes])
    images = np.zeros((len(silhouettes), sizes[:, 1].max(), sizes[:, 0].max()), np.float32)
    for image, item in zip(images, silhouettes, strict=True):
        image[: item.distances.shape[0], : item.distances.shape[1]] = item.distances
    projections = np.stack([item.camera.intrinsics @ item.cam_from_table[:3] for item in silhouettes])
    focals = np.array([0.5 * (item.camera.fx + item.camera.fy) for item in silhouettes])

    def run(part: Grid, wanted: Array, out: Array) -> None:
        layers = np.linspace(0, part.shape[0], 4 * threads + 1).astype(int) if threads > 1 else np.array([0, part.shape[0]])

        def sample(begin: int, end: int) -> None:
            _carve_slab(
                part.origin, part.spacing, begin, end, wanted, images, sizes, projections, focals,
                1.0 - vote, min_views, np.float32(-grid.spacing), out,
            )  # fmt: skip

        with ThreadPoolExecutor(threads) as pool:
            jobs = [pool.submit(sample, a, b) for a, b in zip(layers[:-1], layers[1:], strict=True) if b > a]
            for job in jobs:
                job.result()

    if not coarse or min(grid.shape) < 2 * _COARSE:
        field = np.zeros(grid.shape, np.float32)
        run(grid, np.ones(grid.shape, np.bool_), field)
        return field
    shape = tuple(math.ceil((n - 1) / _COARSE) + 1 for n in grid.shape)
    wide = Grid(grid.origin, grid.spacing * _COARSE, (shape[0], shape[1], shape[2]))
    rough = np.zeros(wide.shape, np.float32)
    run(wide, np.ones(wide.shape, np.bool_), rough)
    axes = [np.arange(n) / _COARSE for n in grid.shape]
    field = _interpolate(rough, axes)
    # Apart from perspective, a distance changes no faster than the position, so a coarse value beyond the cell's diagonal is
    # safe.
    near = np.abs(field) < 1.2 * math.sqrt(3) * wide.spacing
    run(grid, near, field)
    return field


def _interpolate(values: Array, axes: Sequence[Array]) -> Array:
    """Trilinear values at fractional indices, one set per axis. [a, b, c] -> [len(axes[0]), len(axes[1]), len(axes[2])]."""
    out = values
    for index, positions in enumerate(axes):
        low = np.minimum(positions.astype(int), out.shape[index] - 2)
        weight = (positions - low).astype(np.float32)
        weight = weight.reshape([-1 if axis == index else 1 for axis in range(3)])
        out = np.take(out, low, axis=index) * (1 - weight) + np.take(out, low + 1, axis=index) * weight
    return np.ascontiguousarray(out, dtype=np.float32)


def largest_component(field: Array, seeds: Array | None = None) -> Array:
    """Keep one connected part of a field's inside; the other parts become outside.

    Args:
        field: Signed distances, positive inside. [nx, ny, nz].
        seeds: Fractional indices of points that belong to the wanted part; the part that holds most of them wins. [N, 3].

    Returns:
        The field with the other parts negated: their outlines stay where they are, but no longer enclose anything.
    """
    labels, count = ndimage.label(field > 0)
    if count <= 1:
        return field
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    sizes[0] = 0
    best = int(np.argmax(sizes))
    if seeds is not None and len(seeds):
        index = np.clip(np.rint(seeds).astype(int), 0, np.array(field.shape) - 1)
        hits = np.bincount(labels[tuple(index.T)], minlength=count + 1)
        hits[0] = 0
        if hits.max() > 0:
            best = int(np.argmax(hits + sizes / (sizes.sum() + 1.0)))
    return np.where((field > 0) & (labels != best), -np.abs(field), field)


def mesh_of_field(grid: Grid, field: Array) -> Mesh | None:
    """Closed surface at the zero level of a field that is positive inside; None where nothing is inside. [nx, ny, nz].

    The field is padded with outside, so that the surface is closed at the border of the grid too.
    """
    if not (field > 0).any():
        return None
    values = np.pad(field.astype(np.float64), 1, constant_values=-float(grid.spacing))
    # Vertices that fall exactly on a sample point would be shared by several cells as one degenerate triangle.
    tiny = 1e-3 * grid.spacing
    values[np.abs(values) < tiny] = -tiny
    vertices, faces, _, _ = marching_cubes(values, 0.0)
    mesh = Mesh((vertices - 1.0) * grid.spacing + grid.origin, faces.astype(np.int64))
    return mesh if mesh.volume() > 0 else Mesh(mesh.vertices, mesh.faces[:, ::-1].copy())


@njit(nogil=True)
def _rasterise(pixels: Array, depths: Array, faces: Array, out: Array) -> None:
    """Nearest depth per pixel centre; 1/z is linear over the image of a triangle."""
    height, width = out.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        za, zb, zc = depths[a], depths[b], depths[c]
        if za <= 1e-6 or zb <= 1e-6 or zc <= 1e-6:
            continue
        xa, ya = pixels[a, 0] - 0.5, pixels[a, 1] - 0.5
        xb, yb = pixels[b, 0] - 0.5, pixels[b, 1] - 0.5
        xc, yc = pixels[c, 0] - 0.5, pixels[c, 1] - 0.5
        area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
        if abs(area) < 1e-12:
            continue
        left = max(0, int(math.ceil(min(xa, xb, xc))))
        right = min(width - 1, int(math.floor(max(xa, xb, xc))))
        top = max(0, int(math.ceil(min(ya, yb, yc))))
        bottom = min(height - 1, int(math.floor(max(ya, yb, yc))))
        for r in range(top, bottom + 1):
            for q in range(left, right + 1):
                wb = ((q - xa) * (yc - ya) - (xc - xa) * (r - ya)) / area
                wc = ((xb - xa) * (r - ya) - (q - xa) * (yb - ya)) / area
                wa = 1.0 - wb - wc
                if wa < -1e-9 or wb < -1e-9 or wc < -1e-9:
                    continue
                z = 1.0 / (wa / za + wb / zb + wc / zc)
                if z < out[r, q]:
                    out[r, q] = z


def mesh_depth(vertices: Array, faces: Array, camera: Camera, cam_from_table: Array) -> Array:
    """Depth (camera z) of a mesh at every pixel centre.

    Args:
        vertices: Table frame. [V, 3].
        faces: Numbers of the vertices. [F, 3].
        camera: Camera of the view.
        cam_from_table: Its pose. [4, 4].

    Returns:
        Depth in the unit of `vertices`; infinity where there is no mesh. [H, W] float32.
    """
    points = vertices @ cam_from_table[:3, :3].T + cam_from_table[:3, 3]
    pixels = np.nan_to_num(camera.project(points), nan=-1e6)
    out = np.full((camera.height, camera.width), np.inf, np.float32)
    _rasterise(pixels, np.ascontiguousarray(points[:, 2]), np.ascontiguousarray(faces), out)
    return out
