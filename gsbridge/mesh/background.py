"""The mesh stage for backgrounds: the table as an open height field, and a slab below it for collisions."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import Delaunay

from gsbridge.cameras import Views
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.errors import StageError
from gsbridge.files import write_stage
from gsbridge.geometry import Array
from gsbridge.images import read_image
from gsbridge.mesh.fuse import vertex_colours
from gsbridge.mesh.region import TableMap, filmed_region, visible, working_distance
from gsbridge.mesh.relief import agreement, smooth_heights
from gsbridge.mesh.repair import largest_part
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.photogrammetry.sparse import read_points

logger = logging.getLogger("gsbridge")

_STEPS_PER_DISTANCE = 400
"""Heights tried per working distance: steps of about 1 mm at 0.45 m."""
_PATCH_VIEWS = 10
_FLAT_SHARE = 0.006
"""Relief lower than this share of the working distance is noise."""
_TEXTURE = 0.006


def _choose_views(views: Views, table: TableMap, distance: float) -> Array:
    """Choose the views of each cell: near ones, spread around it. [ny, nx, K] int, -1 for none."""
    x, y = np.meshgrid(table.xs, table.ys)
    cells = np.stack([x, y, np.zeros_like(x)], axis=-1)
    seen = np.stack([visible(view, cells, distance) for view in views])
    lengths = np.stack([np.linalg.norm(view.centre - cells, axis=-1) for view in views])
    # Sorting by distance prefers sharp views; the steps through the list below spread them over the orbit.
    cost = np.where(seen & table.filmed, lengths, np.inf)
    order = np.argsort(cost, axis=0)
    number = np.isfinite(cost).sum(0)
    out = np.full((*x.shape, _PATCH_VIEWS), -1, np.int64)
    kept = np.minimum(number, np.maximum(2 * number // 3, _PATCH_VIEWS))
    for k in range(_PATCH_VIEWS):
        place = np.where(kept > _PATCH_VIEWS, (k * kept) // _PATCH_VIEWS, k)
        pick = np.take_along_axis(order, np.minimum(place, len(views) - 1)[None], axis=0)[0]
        out[..., k] = np.where(place < kept, pick, -1)
    return out


def measure_relief(views: Views, table: TableMap, distance: float, settings: MeshSettings, threads: int) -> TableMap:
    """Measure the heights of the table's cells from the photos; exactly 0 where nothing stands.

    Args:
        views: Posed photos.
        table: The filmed cells.
        distance: Working distance, m.
        settings: See `MeshSettings`.
        threads: Threads to use.
    """
    from concurrent.futures import ThreadPoolExecutor

    step = distance / _STEPS_PER_DISTANCE
    heights = step * np.arange(-6, int(settings.relief * distance / step) + 1)
    cameras, greys = [], []
    for view in views:
        camera = view.camera.scaled(min(1.0, settings.image_width / view.camera.width))
        grey = cv2.cvtColor(np.ascontiguousarray(read_image(views.path(view))), cv2.COLOR_RGB2GRAY)
        greys.append(cv2.resize(grey, (camera.width, camera.height), interpolation=cv2.INTER_AREA))
        cameras.append(camera)
    sizes = np.array([grey.shape[::-1] for grey in greys])
    images = np.zeros((len(greys), sizes[:, 1].max(), sizes[:, 0].max()), np.float32)
    for image, grey in zip(images, greys, strict=True):
        image[: grey.shape[0], : grey.shape[1]] = grey
    projections = np.stack([c.intrinsics @ v.cam_from_table[:3] for c, v in zip(cameras, views, strict=True)])
    chosen = _choose_views(views, table, distance)
    # Patch points about 1.6 px apart in the photo.
    pitch = 1.6 * distance / float(np.median([c.fx for c in cameras]))
    score = np.zeros((*table.filmed.shape, len(heights)), np.float32)
    rows = np.linspace(0, len(table.ys), 8 * threads + 1).astype(int)

    def part(a: int, b: int) -> None:
        agreement(images, sizes, projections, chosen[a:b], table.xs, table.ys[a:b], heights, pitch, 3, _TEXTURE, score[a:b])

    with ThreadPoolExecutor(threads) as pool:
        for job in [pool.submit(part, a, b) for a, b in zip(rows[:-1], rows[1:], strict=True) if b > a]:
            job.result()
    # A slight preference for height 0 decides where the photos show no texture.
    bias = 0.06 * (1 - np.exp(-((heights / (2 * step)) ** 2)))
    found, level = smooth_heights(1.0 - score + bias, table.filmed, heights, slope=0.12, limit=1.2)
    zero = int(np.argmin(np.abs(heights)))
    gain = np.take_along_axis(score, level[..., None], axis=2)[..., 0] - score[..., zero - 1 : zero + 2].max(2)
    return replace(table, heights=_significant(found, gain, table, distance))


def _significant(found: Array, gain: Array, table: TableMap, distance: float) -> Array:
    """Heights of parts that clearly stand above the table; 0 elsewhere. [ny, nx].

    Args:
        found: Measured heights. [ny, nx].
        gain: How much better the views agree at the measured height than at height 0, in correlation. [ny, nx].
        table: The filmed cells.
        distance: Working distance, m.
    """
    smooth = ndimage.median_filter(found, 5)
    stands = (smooth > _FLAT_SHARE * distance) & table.filmed
    stands = ndimage.binary_opening(stands, iterations=2)
    labels, number = ndimage.label(stands, structure=np.ones((3, 3)))
    keep = np.zeros(found.shape, bool)
    for label in range(1, number + 1):
        part = labels == label
        # 120 cells are about 4 x 5 cm; smaller parts and parts whose views do not agree better than at 0 are noise.
        if part.sum() >= 120 and gain[part].mean() > 0.08:
            keep |= part
    if not keep.any():
        return np.zeros(found.shape)
    # Lower neighbours of clearly raised parts belong to them: the well of a plate, the foot of a rim.
    keep = ndimage.binary_propagation(keep, mask=(smooth > 0.4 * _FLAT_SHARE * distance) & table.filmed)
    keep = ndimage.binary_fill_holes(keep)
    ring = ndimage.binary_dilation(keep, iterations=2)
    out = np.where(keep | ring, np.maximum(smooth, 0.0), 0.0)
    return np.where(keep | ring, ndimage.gaussian_filter(out, 0.7), 0.0)


def table_mesh(table: TableMap, faces: int) -> Mesh:
    """Open mesh of a map with about `faces` even triangles, three times as dense where the map has relief.

    Raises:
        StageError: The filmed part is too small for a mesh.
    """
    cell = float(table.xs[1] - table.xs[0])
    raised = ndimage.binary_dilation(table.heights > 0, iterations=2)
    flat_area = float((table.filmed & ~raised).sum()) * cell**2
    raised_area = float((table.filmed & raised).sum()) * cell**2
    if flat_area + raised_area == 0:
        raise StageError("mesh", "the filmed part of the table is too small for a mesh", "Film the table from farther away")
    fine = 3.0
    spacing = np.sqrt(2.0 * (flat_area + fine**2 * raised_area) / (0.97 * faces))
    points = []
    for pitch, wanted in ((spacing, ~raised), (max(spacing / fine, 0.5 * cell), raised)):
        x = np.arange(table.xs[0], table.xs[-1] + 1e-9, pitch)
        y = np.arange(table.ys[0], table.ys[-1] + 1e-9, pitch)
        gx, gy = np.meshgrid(x, y)
        i, j = _cell_of(table, gx, gy)
        inside = table.filmed[i, j] & wanted[i, j]
        points.append(np.stack([gx[inside], gy[inside]], axis=-1))
    flat = np.concatenate(points)
    if len(flat) < 16:
        raise StageError("mesh", "the filmed part of the table is too small for a mesh", "Film the table from farther away")
    # Delaunay of an exact lattice has ties; a shift far below the map's accuracy settles them.
    jitter = np.random.default_rng(0).uniform(-1e-3, 1e-3, flat.shape) * spacing
    triangles = Delaunay(flat + jitter).simplices.astype(np.int64)
    corners = flat[triangles]
    centres = corners.mean(axis=1)
    i, j = _cell_of(table, centres[:, 0], centres[:, 1])
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    edge_a, edge_b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    doubled = edge_a[:, 0] * edge_b[:, 1] - edge_a[:, 1] * edge_b[:, 0]
    good = table.filmed[i, j] & (longest < 3.0 * spacing) & (np.abs(doubled) > 1e-2 * longest**2)
    triangles, doubled = triangles[good], doubled[good]
    triangles = np.where(doubled[:, None] > 0, triangles, triangles[:, ::-1])
    index = np.stack([(flat[:, 1] - table.ys[0]) / cell, (flat[:, 0] - table.xs[0]) / cell])
    heights = ndimage.map_coordinates(table.heights, index, order=1, mode="nearest")
    return largest_part(Mesh(np.c_[flat, heights], triangles))


def _cell_of(table: TableMap, x: Array, y: Array) -> tuple[Array, Array]:
    """Row and column of the cell that holds each point."""
    cell = float(table.xs[1] - table.xs[0])
    i = np.clip(np.rint((y - table.ys[0]) / cell).astype(int), 0, len(table.ys) - 1)
    j = np.clip(np.rint((x - table.xs[0]) / cell).astype(int), 0, len(table.xs) - 1)
    return i, j


def slab(table: TableMap, thickness: float, faces: int) -> Mesh:
    """Watertight slab under the map's height field, on a regular grid of the filmed cells.

    Args:
        table: The map.
        thickness: Depth of the slab's flat bottom below z = 0, in the map's unit.
        faces: About how many faces the slab may have; the grid grows coarser until they suffice.

    Raises:
        StageError: The filmed part is too small.
    """
    step = 1
    while 4 * (table.filmed.sum() / step**2) > faces and step < 64:
        step += 1
    rows, columns = np.arange(0, len(table.ys), step), np.arange(0, len(table.xs), step)
    filmed = ndimage.binary_opening(table.filmed[np.ix_(rows, columns)])
    heights = ndimage.maximum_filter(table.heights, step)[np.ix_(rows, columns)]
    # A cell (square between four samples) takes part when its samples do; a pinch between two squares that touch at a
    # corner only would share a wall edge four times, so the opening above and the largest part below remove them.
    square = filmed[:-1, :-1] & filmed[1:, :-1] & filmed[:-1, 1:] & filmed[1:, 1:]
    labels, number = ndimage.label(square)
    if number == 0:
        raise StageError("mesh", "the filmed part of the table is too small for a slab", "Film the table from farther away")
    square = ndimage.binary_fill_holes(labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:])))
    for _ in range(square.size):
        a, b, c, d = square[:-1, :-1], square[:-1, 1:], square[1:, :-1], square[1:, 1:]
        pinch = (a & d & ~b & ~c) | (b & c & ~a & ~d)
        if not pinch.any():
            break
        square[:-1, :-1] |= pinch
        square[:-1, 1:] |= pinch
        square[1:, :-1] |= pinch
        square[1:, 1:] |= pinch
    number_of = np.arange(filmed.size).reshape(filmed.shape)
    i, j = np.nonzero(square)
    p00, p01, p10, p11 = number_of[i, j], number_of[i, j + 1], number_of[i + 1, j], number_of[i + 1, j + 1]
    top = np.concatenate([np.stack([p00, p01, p11], 1), np.stack([p00, p11, p10], 1)])
    x, y = np.meshgrid(table.xs[columns], table.ys[rows])
    upper = np.stack([x.ravel(), y.ravel(), heights.ravel()], 1)
    lower = np.stack([x.ravel(), y.ravel(), np.full(x.size, -thickness)], 1)
    edges = np.concatenate([top[:, [0, 1]], top[:, [1, 2]], top[:, [2, 0]]])
    codes = edges[:, 0] * filmed.size + edges[:, 1]
    border = edges[~np.isin(codes, edges[:, 1] * filmed.size + edges[:, 0])]
    under = filmed.size
    walls = np.concatenate(
        [
            np.stack([border[:, 1], border[:, 0], border[:, 0] + under], 1),
            np.stack([border[:, 1], border[:, 0] + under, border[:, 1] + under], 1),
        ]
    )
    return largest_part(Mesh(np.concatenate([upper, lower]), np.concatenate([top, top[:, ::-1] + under, walls])))


MIN_TABLE_M = (0.9, 0.7)
"""Longer and shorter side of the table that a robot's working area needs, m."""


def mesh_background(
    views: Views,
    points_npz: str | Path,
    out_visual: str | Path,
    out_collision: str | Path,
    out_json: str | Path,
    settings: MeshSettings | None = None,
    seed: int = 0,
    threads: int = 1,
) -> None:
    """Meshes of a table without object.

    Args:
        views: Posed, undistorted photos.
        points_npz: Sparse points of the align stage.
        out_visual: Open mesh of the filmed table with its relief and vertex colours.
        out_collision: Watertight slab under the same heights.
        out_json: Record of the stage.
        settings: See `MeshSettings`.
        seed: Random seed, for the record; nothing here is random.
        threads: Threads to use.

    Raises:
        InputError: A file cannot be used.
        StageError: No part of the table is seen by enough views.
    """
    settings = settings or MeshSettings()
    sparse = read_points(points_npz).points
    distance = working_distance(views)
    table = filmed_region(views, sparse, distance, settings)
    if settings.relief > 0:
        table = measure_relief(views, table, distance, settings, threads)
    visual = table_mesh(table, settings.background_faces)
    collision = slab(table, 0.05 * distance, settings.collision_faces)
    colours = _colours(visual, views, settings.image_width)
    write_mesh(out_visual, Mesh(visual.vertices, visual.faces, colours))
    write_mesh(out_collision, collision)
    raised = table.heights > 0
    cell = float(table.xs[1] - table.xs[0])
    size = np.ptp(visual.vertices, axis=0)[:2]
    reasons = []
    if settings.table_size is None and (size.max() < MIN_TABLE_M[0] or size.min() < MIN_TABLE_M[1]):
        reasons.append(
            f"the table was filmed over {size[0]:.2f} x {size[1]:.2f} m only; {MIN_TABLE_M[0]} x {MIN_TABLE_M[1]} m "
            "are advised, so that the robot's camera never looks past its edge"
        )
    write_stage(
        out_json,
        reasons=reasons,
        seed=seed,
        packages=("scipy", "numba"),
        kind="background",
        method="height field" if raised.any() else "plane",
        visual={
            "watertight": False,
            "faces": len(visual.faces),
            "extents": np.ptp(visual.vertices, axis=0),
            "low": visual.vertices.min(0),
            "high": visual.vertices.max(0),
        },
        collision={"watertight": collision.is_watertight(), "volume": collision.volume(), "faces": len(collision.faces)},
        coverage={"area": float(table.filmed.sum()) * cell**2, "raised_area": float((raised & table.filmed).sum()) * cell**2},
        relief={
            "highest": float(table.heights.max()),
            "mean_raised": float(table.heights[raised].mean()) if raised.any() else 0.0,
        },
    )
    logger.info("mesh: table of %d faces, highest relief %.4f", len(visual.faces), table.heights.max())


def _colours(mesh: Mesh, views: Views, width: int) -> Array:
    """Vertex colours of the table. [V, 3] float32."""
    small, photos = [], []
    for view in views:
        camera = view.camera.scaled(min(1.0, width / view.camera.width))
        photos.append(cv2.resize(read_image(views.path(view)), (camera.width, camera.height), interpolation=cv2.INTER_AREA))
        small.append(replace(view, camera=camera))
    return vertex_colours(mesh, small, photos)
