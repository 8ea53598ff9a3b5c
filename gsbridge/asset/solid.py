"""The mesh that defines an object's body: its surface and the hull of its outlines must tell of one solid."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.meshes import Mesh

logger = logging.getLogger("gsbridge")

_HULL_EXCESS_MM = 3.0
"""The outlines' hull is larger than the surface in dents and under overhangs; more than this on a whole side is logged."""
_DISAGREEMENT = 0.1
"""Part of the longest side by which the hull may be larger than the surface, and of its volume by which it may be smaller."""


@dataclass(frozen=True)
class Solid:
    """The mesh that defines a body.

    Args:
        which: `visual` for the surface, `collision` for the hull of the outlines.
        mesh: Closed mesh, table frame, m.
        reasons: Why the body is degraded, if it is.
    """

    which: str
    mesh: Mesh
    reasons: list[str] = field(default_factory=list)


def choose_solid(visual: Mesh, collision: Mesh, visual_path: str | Path, collision_path: str | Path) -> Solid:
    """Take the surface if it encloses a solid, else the hull of the outlines, and doubt a surface that the hull contradicts.

    Args:
        visual: Surface of the object, table frame, m.
        collision: Hull of the object's outlines in the photos, which encloses the object; table frame, m.
        visual_path, collision_path: Their files, for messages.

    Raises:
        InputError: The meshes lie beside each other, or neither encloses a volume.
    """
    reasons = _doubts_about_place(visual, collision, visual_path, collision_path)
    fault, pieces = _fault(visual)
    if not fault:
        if pieces > 1:
            reasons.append(f"the visual mesh has {pieces} separate pieces, and each counts as solid matter")
        volume, largest = visual.volume(), collision.volume() if collision.is_watertight() else np.inf
        if volume > (1 + _DISAGREEMENT) * largest:
            reasons.append(
                f"the visual mesh encloses {1e6 * volume:.3g} cm3, the outlines' hull {1e6 * largest:.3g} cm3 only; "
                "the mass may be too large"
            )
        return Solid("visual", visual, reasons)
    if collision.is_watertight() and collision.volume() > 0:
        return Solid("collision", collision, [*reasons, f"the visual mesh {fault}; the body is the hull of the outlines"])
    raise InputError(
        visual_path,
        f"the mesh {fault}, and {collision_path} encloses no volume either",
        "Close the mesh and turn its faces outwards, or run the mesh stage again",
    )


def _doubts_about_place(visual: Mesh, collision: Mesh, visual_path: str | Path, collision_path: str | Path) -> list[str]:
    """Compare the bounds of surface and hull: reasons to doubt the body."""
    surface = np.stack([visual.vertices.min(0), visual.vertices.max(0)])
    hull = np.stack([collision.vertices.min(0), collision.vertices.max(0)])
    apart = 1e3 * np.maximum(surface[0] - hull[1], hull[0] - surface[1]).max()
    if apart > 0:
        raise InputError(
            visual_path,
            f"this mesh lies {apart:.0f} mm beside the outlines' hull {collision_path}",
            "Give the mesh of this scene in its table frame, in metres",
        )
    # Row 0 of either: the sides at -x, -y, -z; row 1: those at +x, +y, +z.
    outwards = 1e3 * (surface - hull) * [[-1.0], [1.0]]
    beyond, short = float(outwards.max()), float(-outwards.min())
    if short > _HULL_EXCESS_MM:
        logger.info(
            "the outlines' hull stands out %s mm beyond the surface at -x, -y, -z and %s mm at +x, +y, +z",
            *np.round(np.maximum(-outwards, 0), 1),
        )
    longest = 1e3 * float(np.ptp(collision.vertices, axis=0).max())
    reasons = []
    if beyond > _HULL_EXCESS_MM:
        reasons.append(f"the visual mesh stands out {beyond:.0f} mm beyond the outlines' hull, which should enclose it")
    if short > max(_HULL_EXCESS_MM, _DISAGREEMENT * longest):
        reasons.append(f"the visual mesh ends {short:.0f} mm inside the outlines' hull; a part of it may be missing")
    return reasons


def _fault(mesh: Mesh) -> tuple[str, int]:
    """What keeps a surface from enclosing a solid, empty if nothing does, and the number of its pieces of solid matter."""
    if not mesh.is_watertight():
        return "is not watertight", 0
    count, piece_of_face = _pieces(mesh)
    pieces = [Mesh(mesh.vertices, mesh.faces[piece_of_face == index]) for index in range(count)]
    outer = [piece for piece in pieces if piece.volume() > 0]
    if not outer:
        return "is inside out", 0
    for piece in pieces:
        # A closed cavity is a piece whose faces point inwards, too; it lies within another piece.
        if piece.volume() <= 0 and not any(_encloses(other, piece) for other in outer):
            return "has a piece that is inside out", 0
    return "", len(outer)


def _pieces(mesh: Mesh) -> tuple[int, Array]:
    """Number of connected pieces, and each face's piece. [F]."""
    size = len(mesh.vertices)
    a, b, c = mesh.faces.T
    links = coo_matrix((np.ones(2 * len(a), bool), (np.concatenate([a, b]), np.concatenate([b, c]))), (size, size))
    labels = connected_components(links, directed=False)[1][a]
    found, piece_of_face = np.unique(labels, return_inverse=True)
    return len(found), piece_of_face


def _encloses(outer: Mesh, inner: Mesh) -> bool:
    """True if the bounds of one piece lie within those of another."""
    larger, smaller = outer.corners().reshape(-1, 3), inner.corners().reshape(-1, 3)
    return bool((larger.min(0) <= smaller.min(0)).all() and (larger.max(0) >= smaller.max(0)).all())
