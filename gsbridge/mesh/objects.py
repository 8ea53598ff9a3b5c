"""The mesh stage for objects: collision shape from the hull, visual shape from depth and hull."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gsbridge.cameras import Views
from gsbridge.configuration.mesh import MeshSettings
from gsbridge.errors import StageError
from gsbridge.files import write_stage
from gsbridge.geometry import Array
from gsbridge.images import read_image
from gsbridge.mesh.backends import choose_backend, external_points
from gsbridge.mesh.beside import beside_doubts, points_beside
from gsbridge.mesh.depth import depth_cloud
from gsbridge.mesh.doubts import doubts, frame_doubts, outline_doubts, outline_overlaps
from gsbridge.mesh.fuse import fuse, vertex_colours
from gsbridge.mesh.hollow import carved, guessed_inside, guessed_share, lowered
from gsbridge.mesh.hull import Hull, build_hull, fewest_views, read_masks
from gsbridge.mesh.repair import closed_surface
from gsbridge.meshes import Mesh, write_mesh
from gsbridge.photogrammetry.carving import Grid
from gsbridge.photogrammetry.sparse import read_points
from gsbridge.photogrammetry.standing import find_standing

logger = logging.getLogger("gsbridge")

_FULL_ORBIT_DEG = 200.0
"""Views that cover a smaller angle than this, degrees, leave a side of the object unseen."""
_WHOLE_ORBIT_DEG = 270.0
"""Views that cover a smaller angle than this, degrees, leave a part of one side unseen, which is then bounded only by outlines
from the other side."""


def azimuth_coverage(views: Views, middle: Array) -> float:
    """Angle round the object's middle [3] that the views cover, degrees: 360 minus the widest gap if that gap exceeds 45."""
    centres = np.stack([view.centre for view in views]) - middle
    angles = np.sort(np.degrees(np.arctan2(centres[:, 1], centres[:, 0])) % 360.0)
    gap = float(np.diff(np.r_[angles, angles[0] + 360.0]).max())
    return 360.0 if gap <= 45.0 else 360.0 - gap


def _solid(
    views: Views,
    masks: Sequence[Array],
    hull: Hull,
    sparse: Array,
    settings: MeshSettings,
    narrow: bool,
    seed: int,
    threads: int,
) -> tuple[Grid, Array, dict[str, Any], Array]:
    """Signed distance of the object by the chosen depth backend, figures, and the measured points [N, 3]."""
    backend = choose_backend(settings.backend)
    top = float(hull.mesh.vertices[:, 2].max())
    rough = settings.model_copy(update={"stride": 2 * settings.stride})
    hull = lowered(hull, views, masks, lambda: depth_cloud(views, masks, hull, rough, seed, threads))
    cloud = depth_cloud(views, masks, hull, settings, seed, threads)
    share = sum(int(item.sum()) for item in cloud.confirmed) / max(cloud.tried, 1)
    if backend != "sweep":
        low, high = hull.mesh.vertices.min(0), hull.mesh.vertices.max(0)
        inside = ((sparse > low) & (sparse < high)).all(axis=1)
        points, normals = external_points(backend, views, masks, sparse[inside], threads)
        above = points[:, 2] > 0.5 * hull.grid.spacing
        # The external program's points give the surface. The sweep's depth maps still tell which space is empty, above all in
        # openings.
        cloud = replace(cloud, points=points[above], normals=normals[above])
    logger.info("mesh: %d depth points (%s), %.0f %% of the object's pixels confirmed", len(cloud.points), backend, 100 * share)
    hull, cavity = carved(hull, cloud, threads)
    grid, field, figures = fuse(hull, cloud, views, settings, narrow=narrow, seed=seed)
    figures |= {"backend": backend, "confirmed_share": share, "cavity_share": cavity}
    figures["lowered_share"] = 1.0 - float(hull.mesh.vertices[:, 2].max()) / top
    return grid, field, figures, cloud.points


def _figures(mesh: Mesh) -> dict[str, Any]:
    """Figures of one mesh for the record."""
    return {
        "watertight": mesh.is_watertight(),
        "volume": mesh.volume(),
        "faces": len(mesh.faces),
        "extents": np.ptp(mesh.vertices, axis=0),
        "low": mesh.vertices.min(0),
        "high": mesh.vertices.max(0),
    }


def mesh_object(
    views: Views,
    masks_dir: str | Path,
    points_npz: str | Path,
    out_visual: str | Path,
    out_collision: str | Path,
    out_json: str | Path,
    settings: MeshSettings | None = None,
    seed: int = 0,
    threads: int = 1,
) -> None:
    """Meshes of an object in the table frame.

    Args:
        views: Posed, undistorted photos.
        masks_dir: Masks of the masks stage.
        points_npz: Sparse points of the align stage.
        out_visual: Watertight mesh with vertex colours, to which splats are bound.
        out_collision: Watertight visual hull.
        out_json: Record of the stage.
        settings: See `MeshSettings`.
        seed: Random seed.
        threads: Threads to use.

    Raises:
        InputError: A file or setting cannot be used.
        StageError: The masks share no volume, or no closed mesh comes out.
    """
    settings = settings or MeshSettings()
    masks = read_masks(views, masks_dir)
    sparse = read_points(points_npz).points
    hull = build_hull(
        views, masks, vote=settings.hull_vote, voxels=settings.hull_voxels, width=settings.image_width, threads=threads
    )
    coverage = azimuth_coverage(views, 0.5 * (hull.mesh.vertices.min(0) + hull.mesh.vertices.max(0)))
    narrow = coverage < _FULL_ORBIT_DEG
    grid, field, figures, measured = _solid(views, masks, hull, sparse, settings, narrow, seed, threads)
    visual = closed_surface(grid, field, settings.faces)
    collision = closed_surface(hull.grid, hull.field, settings.collision_faces)
    reasons = []
    if narrow:
        reasons.append(f"the views cover {coverage:.0f} degrees round the object; its unseen side is a guess")
    elif coverage < _WHOLE_ORBIT_DEG:
        gap = 360 - coverage
        reasons.append(
            f"the views leave a gap of {gap:.0f} degrees round the object; what faces into it is a guess; film it, too"
        )
    if visual is None:
        reasons.append("the surface of the depth could not be closed; the visual mesh is the hull")
        visual, figures["method"] = closed_surface(hull.grid, hull.field, settings.faces), "hull"
    else:
        figures["method"] = "depth and hull, Poisson"
    if (narrow or figures["cavity_share"] or figures["lowered_share"]) and figures["method"] != "hull":
        # A hull seen from one side is a pair of cones, and no hull is hollow; the fused solid is then better for contacts, too.
        collision = closed_surface(grid, field, settings.collision_faces) or collision
    if visual is None or collision is None:
        raise StageError("mesh", "no closed mesh comes out of the masks", "Look at the masks and at the poses")
    if figures.get("hull_share", 0.0) > 0.6:
        reasons.append(f"{100 * figures['hull_share']:.0f} % of the surface has no depth and comes from the outlines alone")
    focus = 0.5 * (visual.vertices.min(0) + visual.vertices.max(0))
    distance = float(np.median([np.linalg.norm(view.centre - focus) for view in views]))
    members = sparse[find_standing(sparse, focus, distance).members]
    figures["guessed_share"] = guessed_share(visual, measured)
    centres = np.stack([view.centre for view in views])
    inside = guessed_inside(visual, measured, hull.mesh, centres)
    figures["guessed_inside_share"], figures["guessed_inside_reach"] = inside
    reasons += doubts(visual, members, figures)
    overlaps = outline_overlaps(visual, views, masks)
    reasons += outline_doubts(overlaps, [view.name for view in views])
    if not narrow:
        reasons += beside_doubts(visual, points_beside(views, masks, settings, seed, threads))
    reasons += frame_doubts(visual, views, fewest_views(int(np.isfinite(overlaps).sum())))
    figures["outline_overlap"] = {"mean": float(np.nanmean(overlaps)), "min": float(np.nanmin(overlaps))}
    photos, small = [], []
    for view in views:
        camera = view.camera.scaled(min(1.0, settings.image_width / view.camera.width))
        image = read_image(views.path(view))
        photos.append(cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA))
        small.append(replace(view, camera=camera))
    visual = Mesh(visual.vertices, visual.faces, vertex_colours(visual, small, photos))
    write_mesh(out_visual, visual)
    write_mesh(out_collision, collision)
    write_stage(
        out_json,
        reasons=reasons,
        seed=seed,
        packages=("open3d", "pymeshlab", "scikit-image", "numba"),
        kind="object",
        visual=_figures(visual),
        collision=_figures(collision),
        coverage_deg=coverage,
        **figures,
    )
    logger.info("mesh: visual %d faces, collision %d faces, %s", len(visual.faces), len(collision.faces), figures["method"])
