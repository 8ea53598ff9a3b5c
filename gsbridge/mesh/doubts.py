"""Reasons why a closed mesh may be wrong, from data that did not shape it: sparse points, and the outlines one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from gsbridge.cameras import View
from gsbridge.geometry import Array
from gsbridge.mesh.repair import depth_inside
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.carving import mesh_depth
from gsbridge.photogrammetry.cavity import cavity_depth

_DISAGREE = 0.1
"""Tolerance between mesh and measured points, as a share of three quantities: of the height; of the object's size, for the
distance of the inner surface from all points; and of the points, for those that lie off the mesh."""
_UNSEEN = 0.5
"""If more than this share of the upward surface has no depth, its shape is a guess."""
_GUESSED = 0.15
"""If more than this share of the upward surface, or of the surface that no outline shows, is far from all measured points, its
shape is a guess."""
_FEW_POINTS = 30
"""With fewer measured points than this, mesh and points are not compared."""
_OUTLINE_WIDTH = 320
"""Masks are compared with the mesh at this width, px."""
_COVERED = 0.9
"""Mean overlap (IoU) of masks and mesh below which either masks or mesh are wrong."""
_AHEAD = 0.03
"""How far in front of a surface the photos must still show space, as a share of the object's size; if they do not, the surface
may be the edge of the photos instead of the object's."""
_CUT_OFF = 0.02
"""Share of the surface that may lie at the edge of the photos."""
_UNLIKE = 0.85
"""Overlap (IoU) below which a single photo contradicts the mesh; a tenth of the photos may do so."""


def doubts(mesh: Mesh, members: Array, shares: Mapping[str, float]) -> list[str]:
    """Why a closed mesh may be wrong: it disagrees with the measured points, or parts of it were not measured at all.

    Args:
        mesh: Mesh of the object, standing on z = 0.
        members: Sparse points of the object, m. [K, 3].
        shares: Five figures, 0..1. `open_share`: share of the upward surface without depth. `cavity_share`: share of the hull's
            volume that measured depth has emptied. `guessed_share` and `guessed_inside_share`: share of the upward surface, and
            of the surface that no outline shows, near which nothing was measured. `guessed_inside_reach`: how far that last
            surface lies from all measured points, as a share of the object's size.

    Returns:
        One reason for each disagreement; none if the mesh can be trusted.
    """
    reasons = []
    size = float(np.ptp(mesh.vertices, axis=0).max())
    what = ""
    if shares["open_share"] > _UNSEEN:
        what = f"{100 * shares['open_share']:.0f} % of the surface that faces upward has no depth"
    elif shares["cavity_share"] and shares["guessed_share"] > _GUESSED:
        what = f"nothing was measured near {100 * shares['guessed_share']:.0f} % of the surface that faces upward"
    if what:
        # The mesh is scaled to a size of 0.1 m, since the true scale may be unknown.
        if cavity_depth(Mesh(mesh.vertices * (0.1 / size), mesh.faces)):
            reasons.append(f"{what}: the bottom of its opening is unseen and a guess; film from higher up as well")
        else:
            reasons.append(
                f"{what}: it is hidden or too plain, and whether it is open there is unknown; film from higher up as well, or "
                "lay something small and patterned on it"
            )
    elif shares["cavity_share"] and shares["guessed_inside_share"] > _GUESSED:
        reasons.append(
            f"nothing was measured near {100 * shares['guessed_inside_share']:.0f} % of the surface that no outline shows: the "
            "inside of its opening is a guess there; film it from higher up, more closely, and without strong compression"
        )
    elif shares["cavity_share"] and shares["guessed_inside_reach"] > _DISAGREE:
        reasons.append(
            f"inside its opening the surface lies up to {100 * shares['guessed_inside_reach']:.0f} % of the object's size from "
            "all that was measured: there may be a heap or a pit there; film it from higher up and more closely"
        )
    if len(members) < _FEW_POINTS:
        return reasons
    top, measured = float(mesh.vertices[:, 2].max()), float(np.percentile(members[:, 2], 99.5))
    if abs(top - measured) > _DISAGREE * max(top, measured):
        reasons.append(
            f"the mesh is {1e3 * top:.0f} mm tall, the measured points reach {1e3 * measured:.0f} mm; look at its top"
        )
    inside = depth_inside(mesh, members)
    for wrong, what in (
        (inside < -0.04 * size, "outside the mesh: a part of the object is missing, or something else stands beside it"),
        (inside > 0.05 * size, "deep inside the mesh: the object is hollow or open where the mesh is solid"),
    ):
        if wrong.mean() > _DISAGREE:
            reasons.append(f"{int(wrong.sum())} of {len(members)} points measured on the object lie {what}")
    return reasons


def outline_overlaps(mesh: Mesh, views: Sequence[View], masks: Sequence[Array]) -> Array:
    """Overlap (IoU) of each view's mask with the mesh as the view sees it; NaN for an empty mask. [V].

    Args:
        mesh: The mesh, table frame.
        views: Posed views.
        masks: Their masks, 0..1. [H, W] each.
    """
    out = np.full(len(views), np.nan)
    for index, (view, mask) in enumerate(zip(views, masks, strict=True)):
        camera = view.camera.scaled(min(1.0, _OUTLINE_WIDTH / view.camera.width))
        inside = cv2.resize(mask, (camera.width, camera.height), interpolation=cv2.INTER_AREA) > 0.5
        if inside.any():
            covered = np.isfinite(mesh_depth(mesh.vertices, mesh.faces, camera, view.cam_from_table))
            out[index] = (inside & covered).sum() / (inside | covered).sum()
    return out


def outline_doubts(overlaps: Array, names: Sequence[str]) -> list[str]:
    """Report outlines that contradict a mesh.

    Args:
        overlaps: See `outline_overlaps`. [V].
        names: Names of the photos.
    """
    known = overlaps[np.isfinite(overlaps)]
    if len(known) == 0:
        return []
    worst = int(np.nanargmin(overlaps))
    where = f"the least in {names[worst]}, {overlaps[worst]:.2f}"
    if known.mean() < _COVERED:
        return [f"masks and mesh overlap by {known.mean():.2f} only (IoU; {where}): a part is missing, or filled that is open"]
    unlike = int((known < _UNLIKE).sum())
    if unlike > 0.1 * len(known):
        return [f"in {unlike} of {len(known)} photos mask and mesh overlap by less than {_UNLIKE:g} (IoU; {where})"]
    return []


def frame_doubts(mesh: Mesh, views: Sequence[View], fewest: int) -> list[str]:
    """Report a mesh that is cut off by the photos' borders: the space in front of a part of its surface is outside the photos.

    Args:
        mesh: The mesh, table frame.
        views: Posed views.
        fewest: Views that must show a place before the hull can hold it.
    """
    size = float(np.ptp(mesh.vertices, axis=0).max())
    normals, areas = mesh.normals(), mesh.areas()
    ahead = mesh.corners().mean(1) + _AHEAD * size * normals
    seen = np.zeros(len(ahead), int)
    for view in views:
        pixels = view.camera.project(ahead @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3])
        seen += ((pixels >= 0) & (pixels < (view.camera.width, view.camera.height))).all(axis=1)
    cut = (seen < fewest) & (ahead[:, 2] > _AHEAD * size)
    share = float(areas[cut].sum() / areas.sum())
    if share <= _CUT_OFF:
        return []
    top = cut & (normals[:, 2] > 0.5)
    where = "top" if areas[top].sum() > 0.5 * areas[cut].sum() else "side"
    return [
        f"{100 * share:.0f} % of the mesh ends where the photos do, most at its {where}: fewer than {fewest} of {len(views)} "
        "show what lies beyond; film again with the whole object in the picture"
    ]
