"""The part of the table that a background's photos show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import Delaunay, cKDTree

from gsbridge.cameras import View, Views
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.errors import StageError
from gsbridge.geometry import Array

_CELLS_PER_DISTANCE = 110
"""Map cells per working distance: about 4 mm at 0.45 m."""
_REACH = 2.2
"""A view counts for parts of the table up to this many working distances away."""
_SURE = 0.5
"""Within this many working distances of the point that the cameras look at, the table is assumed to be there even without
sparse points."""
_MIN_FALL = 0.17
"""Lines of sight that meet the table flatter than 10 degrees show too little of it."""


@dataclass(frozen=True)
class TableMap:
    """A map of the table with heights.

    Args:
        xs, ys: Cell centres. [nx], [ny].
        filmed: Whether enough views see a cell. [ny, nx] bool.
        heights: Height of the surface. [ny, nx].
    """

    xs: Array
    ys: Array
    filmed: Array
    heights: Array


def working_distance(views: Views) -> float:
    """Median distance from the cameras to the points where their optical axes meet the table."""
    distances = []
    for view in views:
        axis = view.cam_from_table[2, :3]
        if axis[2] < -0.05:
            distances.append(view.centre[2] / -axis[2])
    if len(distances) < 3:
        raise StageError("mesh", "hardly any photo looks down at the table", "Look at the align stage's plane")
    return float(np.median(distances))


def filmed_region(views: Views, sparse: Array, distance: float, settings: MeshSettings) -> TableMap:
    """Cells of the table that enough views see from near enough.

    Args:
        views: Posed photos.
        sparse: Sparse points; those far below the table show where the table ends. [N, 3].
        distance: Working distance, m.
        settings: See `MeshSettings`.

    Raises:
        StageError: No part of the table is seen by enough views.
    """
    cell = distance / _CELLS_PER_DISTANCE
    targets = np.stack([v.centre - v.cam_from_table[2, :3] * v.centre[2] / min(v.cam_from_table[2, 2], -0.05) for v in views])
    middle = np.median(targets[:, :2], axis=0)
    half = np.array([1.6 * distance] * 2) if settings.table_size is None else 0.5 * np.asarray(settings.table_size)
    count = np.ceil(2 * half / cell).astype(int)
    xs = middle[0] - half[0] + cell * (np.arange(count[0]) + 0.5)
    ys = middle[1] - half[1] + cell * (np.arange(count[1]) + 0.5)
    x, y = np.meshgrid(xs, ys)
    cells = np.stack([x, y, np.zeros_like(x)], axis=-1)
    seen = sum(visible(view, cells, distance).astype(int) for view in views)
    filmed = seen >= settings.min_views
    filmed &= ~_beyond_edge(views, sparse, xs, ys, distance)
    filmed &= _supported(sparse, middle, x, y, distance)
    filmed = ndimage.binary_opening(filmed, iterations=2)
    labels, number = ndimage.label(filmed)
    if number == 0:
        raise StageError(
            "mesh", f"no part of the table is seen by {settings.min_views} photos", "Film more slowly, with the table in view"
        )
    best = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    filmed = ndimage.binary_fill_holes(labels == best)
    return TableMap(xs, ys, filmed, np.zeros(filmed.shape))


def _supported(sparse: Array, middle: Array, x: Array, y: Array, distance: float) -> Array:
    """Cells between sparse points of the table, or near the middle; elsewhere the table may have ended. [ny, nx] bool."""
    near = np.hypot(x - middle[0], y - middle[1]) < _SURE * distance
    flat = sparse[np.abs(sparse[:, 2]) < 0.012 * distance][:, :2]
    if len(flat) >= 50:
        # A point of the table has others beside it; wrong matches, and distant things at this height, are isolated.
        flat = flat[np.asarray(cKDTree(flat).query(flat, k=6)[0])[:, -1] < 0.1 * distance]
    if len(flat) < 50:
        return near
    return near | (Delaunay(flat).find_simplex(np.stack([x, y], axis=-1)) >= 0)


def visible(view: View, cells: Array, distance: float) -> Array:
    """Cells that a view sees from near and steeply enough.

    Args:
        view: Posed photo.
        cells: Centres of the cells, table frame. [ny, nx, 3].
        distance: Working distance, in the unit of `cells`.

    Returns:
        True where a cell is seen. [ny, nx] bool.
    """
    camera = view.camera
    local = cells @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3]
    pixels = camera.project(local)
    rays = view.centre - cells
    length = np.linalg.norm(rays, axis=-1)
    border = 6
    with np.errstate(invalid="ignore"):
        inside = (pixels > border).all(-1) & (pixels[..., 0] < camera.width - border)
        inside &= pixels[..., 1] < camera.height - border
    return inside & (length < _REACH * distance) & (rays[..., 2] > _MIN_FALL * length)


def _beyond_edge(views: Views, sparse: Array, xs: Array, ys: Array, distance: float) -> Array:
    """Cells through which several lines of sight reach ground far below the table: the table is not there. [ny, nx] bool."""
    below = sparse[(sparse[:, 2] < -0.15 * distance) & (np.linalg.norm(sparse, axis=1) < 6 * distance)]
    hits = np.zeros((len(ys), len(xs)))
    if len(below) < 20:
        return hits > 0
    cell = xs[1] - xs[0]
    for view in views:
        local = below @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3]
        pixels = view.camera.project(local)
        inside = np.isfinite(pixels).all(1) & (pixels > 0).all(1)
        inside &= (pixels < (view.camera.width, view.camera.height)).all(1)
        points = below[inside]
        t = view.centre[2] / (view.centre[2] - points[:, 2])
        cross = view.centre[:2] + t[:, None] * (points[:, :2] - view.centre[:2])
        index = np.floor((cross - (xs[0], ys[0])) / cell + 0.5).astype(int)
        valid = (index >= 0).all(1) & (index[:, 0] < len(xs)) & (index[:, 1] < len(ys))
        np.add.at(hits, (index[valid, 1], index[valid, 0]), 1)
    # Wrongly matched points are rare and scattered, while points of the floor seen past the table's edge are dense.
    return ndimage.gaussian_filter(hits, 3) > 0.5
