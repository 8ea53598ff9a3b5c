"""Visual hull of an object from its masks: the collision shape, and the bounds of the depth search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage

from gsbridge.cameras import View, Views
from gsbridge.errors import StageError
from gsbridge.geometry import Array
from gsbridge.images import read_mask
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.carving import Grid, Silhouette, carve, largest_component, mesh_of_field, signed_distances

_BELOW = 2
"""Grid layers below the table, so that the cut at z = 0 is a level set like every other surface."""


@dataclass(frozen=True)
class Hull:
    """Visual hull of an object.

    Args:
        grid: Sample points.
        field: Signed distance, positive inside, cut at the table. [nx, ny, nz].
        uncut: The field before the cut at the table. [nx, ny, nz].
        mesh: Surface of `field`.
    """

    grid: Grid
    field: Array
    uncut: Array
    mesh: Mesh

    @property
    def size(self) -> float:
        """Longest side of the hull's bounding box."""
        return float(np.ptp(self.mesh.vertices, axis=0).max())


def read_masks(views: Views, folder: str | Path) -> list[Array]:
    """Masks of the views, 0..1, one `{stem}.png` each. [H, W] float32 each.

    Raises:
        InputError: A mask is missing or damaged.
        StageError: A mask has another size than its photo.
    """
    masks = []
    for view in views:
        mask = read_mask(Path(folder) / f"{Path(view.name).stem}.png")
        if mask.shape != (view.camera.height, view.camera.width):
            raise StageError("mesh", f"the mask of {view.name} has another size than its photo", "Run the masks stage again")
        masks.append(mask)
    return masks


def silhouettes(views: Sequence[View], masks: Sequence[Array], width: int) -> list[Silhouette]:
    """Signed distances of all masks that show anything.

    Args:
        views: Posed photos.
        masks: One per view, 0..1. [H, W] each.
        width: Width that wider masks are shrunk to, px.
    """
    out = []
    for view, mask in zip(views, masks, strict=True):
        camera = view.camera.scaled(min(1.0, width / view.camera.width))
        small = cv2.resize(mask, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
        if (small > 0.5).any():
            out.append(Silhouette(signed_distances(small), camera, view.cam_from_table))
    return out


def object_box(outlines: Sequence[Silhouette]) -> tuple[Array, Array]:
    """Box that holds the object: round the point nearest to the rays through the masks' centres, as wide as the masks.

    Returns:
        Lowest and highest corner, the lowest at z = 0. [3], [3].

    Raises:
        StageError: The masks' rays do not meet above the table in front of the cameras.
    """
    a, b = np.zeros((3, 3)), np.zeros(3)
    rays, radii = [], []
    for item in outlines:
        rows, columns = np.nonzero(item.distances > 0)
        pixel = np.array([columns.mean() + 0.5, rows.mean() + 0.5, 1.0])
        pose = item.cam_from_table
        direction = pose[:3, :3].T @ np.linalg.solve(item.camera.intrinsics, pixel)
        direction /= np.linalg.norm(direction)
        centre = -pose[:3, :3].T @ pose[:3, 3]
        across = np.eye(3) - np.outer(direction, direction)
        a += across
        b += across @ centre
        reach = np.hypot(columns + 0.5 - pixel[0], rows + 0.5 - pixel[1]).max() / item.camera.fx
        rays.append((centre, direction))
        radii.append(reach)
    middle = np.linalg.solve(a, b)
    # The median tolerates a few masks that are far too large; the margin makes up for views whose radius exceeds the median.
    radius = 1.35 * float(np.median([reach * np.linalg.norm(middle - c) for reach, (c, _) in zip(radii, rays, strict=True)]))
    ahead = np.mean([float((middle - c) @ d) > 0 for c, d in rays])
    if ahead < 0.9 or middle[2] + radius <= 0 or not np.isfinite(radius):
        raise StageError("mesh", "the masks of the views point to no common place above the table", "Look at the masks")
    low, high = middle - radius, middle + radius
    low[2] = 0.0
    return low, high


def fewest_views(masks: int) -> int:
    """Number of masks, out of those that show the object, that must cover a point before the hull can contain it."""
    return max(2, masks // 6)


def build_hull(views: Sequence[View], masks: Sequence[Array], *, vote: float, voxels: int, width: int, threads: int) -> Hull:
    """Visual hull of the masks, cut at the table.

    Args:
        views, masks: Posed views and their masks. [H, W] each.
        vote: Share of the views that must agree.
        voxels: Samples along the longest side.
        width: Masks are shrunk to this width.
        threads: Threads to use.

    Raises:
        StageError: The masks share no volume above the table.
    """
    outlines = silhouettes(views, masks, width)
    if len(outlines) < 3:
        raise StageError("mesh", f"only {len(outlines)} masks show the object, 3 are needed", "Look at the masks")
    low, high = object_box(outlines)
    fewest = fewest_views(len(outlines))
    for level in (vote, 0.9 * vote, 0.75 * vote):
        coarse = Grid.covering(low, high, float((high - low).max()) / 64)
        field = carve(coarse, outlines, vote=level, min_views=fewest, threads=threads)
        field = largest_component(field)
        inside = np.argwhere(field > -1.5 * coarse.spacing)
        if (field > 0).any():
            break
    else:
        raise StageError("mesh", "the masks share no volume above the table", "Look at the masks and at the poses")
    tight_low = coarse.origin + coarse.spacing * (inside.min(0) - 1)
    tight_high = coarse.origin + coarse.spacing * (inside.max(0) + 1)
    spacing = float((tight_high - tight_low).max()) / voxels
    tight_low[2] = -_BELOW * spacing
    grid = Grid.covering(tight_low, tight_high, spacing)
    uncut = carve(grid, outlines, vote=level, min_views=fewest, threads=threads)
    # The masks are accurate to about a pixel, so steps finer than a voxel are noise.
    uncut = ndimage.gaussian_filter(uncut, 0.8)
    field = largest_component(np.minimum(uncut, grid.axis(2).astype(np.float32)[None, None, :]))
    mesh = mesh_of_field(grid, field)
    if mesh is None:
        raise StageError("mesh", "the hull vanished on the fine grid", "Look at the masks and at the poses")
    return Hull(grid, field, uncut, mesh)
