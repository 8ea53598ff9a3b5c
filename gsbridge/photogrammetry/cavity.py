"""Cavities of an object on the table: its heights as seen from above, and how deep water would stand in it."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from gsbridge.geometry import Array
from gsbridge.libraries import import_open3d
from gsbridge.meshes import Mesh

CELL_M = 0.001
"""Spacing of the grid of heights from which cavities are measured, m."""
LEAST_M = 0.010
"""Dents shallower than this are no cavities, m."""
_DEEPEST = 90
"""Percentile of the depths in a cavity that is taken as its depth, so that a single deep spike does not count."""


def heights_from_above(mesh: Mesh, low: Array, high: Array) -> Array:
    """Height of the first surface from above on a grid of `CELL_M`, 0 where there is none. -> [nx, ny], m.

    Args:
        mesh: A surface above the table, z up, m.
        low, high: Corners of the area. [2] each.
    """
    open3d = import_open3d()
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    # Rays are shifted by an odd fraction of a cell, so that they do not run along walls.
    x, y = (np.arange(a, b, CELL_M) + 0.37 * CELL_M for a, b in zip(low, high, strict=True))
    top = float(mesh.vertices[:, 2].max()) + 0.1
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    rays = np.zeros((*grid.shape[:2], 6), np.float32)
    rays[..., :2], rays[..., 2], rays[..., 5] = grid, top, -1.0
    hit = scene.cast_rays(rays, nthreads=1)["t_hit"].numpy()
    return np.where(np.isfinite(hit), np.maximum(top - hit, 0.0), 0.0)


def water_depth(heights: Array) -> Array:
    """Depth to which water would stand at each place, m; 0 where it runs off. [nx, ny] heights, m -> [nx, ny].

    Water runs off wherever the table shows from above, as within a ring that lies on the table.
    """
    from skimage.morphology import reconstruction

    # Water stands as high as the lowest way out. The erosion starts full everywhere but on the table, where water runs off.
    start = np.where(heights > 0, heights.max(), 0.0)
    return np.asarray(reconstruction(start, heights, method="erosion") - heights)


def cavity_depth(mesh: Mesh) -> float:
    """Depth to which water would stand in an object on the table, m; 0 if it holds no water.

    Water runs off wherever the table shows from above, as within a ring that lies on the table.
    """
    low, high = mesh.vertices[:, :2].min(0) - 3 * CELL_M, mesh.vertices[:, :2].max(0) + 3 * CELL_M
    depth = water_depth(heights_from_above(mesh, low, high))
    labels, count = ndimage.label(depth > 0.5 * LEAST_M)
    if count == 0:
        return 0.0
    volumes = ndimage.sum_labels(depth, labels, np.arange(1, count + 1))
    found = float(np.percentile(depth[labels == 1 + int(np.argmax(volumes))], _DEEPEST))
    return found if found > LEAST_M else 0.0
