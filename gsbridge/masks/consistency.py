"""Agreement of the masks of all views: their visual hull, and its outline in each view."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import cv2
import numpy as np

from gsbridge.cameras import Camera, View
from gsbridge.configuration.masks import MaskSettings
from gsbridge.errors import StageError
from gsbridge.geometry import Array
from gsbridge.masks.prompt import Prompt
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.carving import (
    Grid,
    Silhouette,
    carve,
    largest_component,
    mesh_depth,
    mesh_of_field,
    signed_distances,
)

logger = logging.getLogger("gsbridge")

_HULL_WIDTH = 640
"""Masks are shrunk to this width for the hull."""

_GROUND = 0.004
"""Height above the table at which the hull starts, as a share of the working distance, so that it excludes shadows on the
table."""

_FEW = 0.1
"""Largest share of masks that may disagree with the hull; the others outvote them."""


def hull_of_masks(
    views: Sequence[View], masks: Sequence[Array], prompt: Prompt, *, vote: float, voxels: int, threads: int
) -> Mesh | None:
    """Visual hull of masks, grown to the table.

    Only views with a mask that is not empty vote: an empty mask is a failed one, not a proof that there is no object.

    Args:
        views: Posed photos.
        masks: One per view, of any size; cameras are scaled to it. [h, w] each.
        prompt: Where the object stands.
        vote: Share of the views that see a point which must show it as part of the object.
        voxels: Samples along the longest edge of the prompt's box.
        threads: Threads to use.

    Returns:
        The hull, table frame; None where the masks share no point.
    """
    silhouettes = []
    for view, mask in zip(views, masks, strict=True):
        if mask.any():
            camera = view.camera.scaled(mask.shape[1] / view.camera.width)
            silhouettes.append(Silhouette(signed_distances(mask), camera, view.cam_from_table))
    if len(silhouettes) < 2:
        return None
    spacing = float((prompt.high - prompt.low).max()) / voxels
    ground = _GROUND * prompt.distance
    grid = Grid.covering(np.array([prompt.low[0], prompt.low[1], ground]), prompt.high, spacing)
    field = carve(grid, silhouettes, vote=vote, min_views=min(3, len(silhouettes)), threads=threads)
    field = largest_component(field, (prompt.points - grid.origin) / spacing)
    mesh = mesh_of_field(grid, field)
    if mesh is None:
        return None
    # Stretch the lowest layer down to the table, on which the object stands.
    vertices = mesh.vertices.copy()
    vertices[vertices[:, 2] < ground + 0.25 * spacing, 2] = 0.0
    return Mesh(vertices, mesh.faces)


def outline(mesh: Mesh, camera: Camera, cam_from_table: Array) -> Array:
    """Pixels that a mesh covers. [H, W] bool.

    Args:
        mesh: A mesh, table frame.
        camera: Camera of the view.
        cam_from_table: Its pose. [4, 4].
    """
    return np.isfinite(mesh_depth(mesh.vertices, mesh.faces, camera, cam_from_table))


def overlap(first: Array, second: Array) -> float:
    """Intersection over union of two masks; 1 for two empty ones. [H, W] bool each."""
    union = np.logical_or(first, second).sum()
    return float(np.logical_and(first, second).sum() / union) if union else 1.0


def shrunk(mask: Array) -> Array:
    """The mask at the size that the hull is made from. [H, W] float -> [h, w] bool."""
    scale = min(1.0, _HULL_WIDTH / mask.shape[1])
    if scale == 1.0:
        return mask > 0.5
    return cv2.resize(mask, (round(mask.shape[1] * scale), round(mask.shape[0] * scale)), interpolation=cv2.INTER_AREA) > 0.5


def agreed_hull(
    views: Sequence[View], masks: Sequence[Array], prompt: Prompt, settings: MaskSettings, wanted: float, threads: int
) -> Mesh:
    """Visual hull of the masks; the vote is lowered if the masks share no point.

    Args:
        views: Posed photos.
        masks: One per view. [H, W] each.
        prompt: Where the object stands.
        settings: See `MaskSettings`.
        wanted: The vote; if the masks share no point, 85 % and then 70 % of it are tried.
        threads: Threads to use.

    Raises:
        StageError: The masks share no point at the lowest vote either.
    """
    small = [shrunk(mask) for mask in masks]
    for vote in (wanted, 0.85 * wanted, 0.7 * wanted):
        hull = hull_of_masks(views, small, prompt, vote=vote, voxels=settings.hull_voxels, threads=threads)
        if hull is not None:
            return hull
        logger.warning("masks: no hull at vote %.2f", vote)
    raise StageError(
        "masks",
        "the outlines of the object found in the photos share no common volume",
        "Check the poses of the sfm stage, film the object on a table of another colour, or use the sam2 backend with weights",
    )


def disagreements(agreement: Sequence[float], names: Sequence[str], least: float) -> list[str]:
    """Report masks that disagree with their common hull, on average or one by one, and name the worst.

    Args:
        agreement: Overlap (IoU) of each mask with the common hull as its photo sees it.
        names: Names of the photos.
        least: Overlap below which masks are in doubt.
    """
    mean = float(np.mean(agreement))
    worst = int(np.argmin(agreement))
    where = f"(IoU; {least:.2f} is good; the least in {names[worst]}, {agreement[worst]:.2f})"
    if mean < least:
        return [f"masks and their common hull agree to {mean:.2f} only {where}"]
    unlike = sum(value < least for value in agreement)
    return [f"{unlike} of {len(names)} masks disagree with their common hull {where}"] if unlike > _FEW * len(names) else []
