"""Remeshing to even triangles for the binding: splats take their shape from faces, so slivers would give bad splats."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from gsbridge.geometry import Array
from gsbridge.meshes import Mesh

if TYPE_CHECKING:
    import pymeshlab

logger = logging.getLogger("gsbridge")

ITERATIONS = 6
GRADING = 3
"""Number of iterations of each step from one size to the next; fewer suffice, because the faces are already even."""

FEATURE_DEG = 60.0
"""Angle above which an edge counts as sharp and is kept, degrees."""

UNSEEN = 3.0
"""Edge length where no camera looks, relative to that elsewhere."""

FINER, COARSER = (0.71, 0.5, 0.35, 0.25), (1.41, 2.0, 2.83)
"""Relative edge lengths used to meet given sizes. MeshLab takes one length at a time, so each builds on the one before."""

DENSE = 4
"""Multiple of the face budget above which a mesh is decimated first, which is faster and changes nothing visible."""


def remesh_isotropic(
    mesh: Mesh,
    max_faces: int,
    *,
    seen: Callable[[Mesh], Array] | None = None,
    sizes: Callable[[Mesh], Array] | None = None,
    attempts: int = 8,
) -> Mesh:
    """Rebuild a surface with at most `max_faces` nearly equilateral faces, of one size or of given relative sizes.

    Open meshes keep their border. Colours are dropped, because splats learn their own.

    Args:
        mesh: Surface, table frame, m.
        max_faces: Upper limit of the number of faces.
        seen: Function that tells which faces of a mesh any camera sees, [F] bool; other faces become larger, because no photo
            shows detail there. None for all faces.
        sizes: Function that gives the relative edge length at each face of a mesh, [F]; it is met in steps of a factor of
            about sqrt(2). None for one size.
        attempts: Number of attempts with a corrected edge length to come close to the limit.

    Returns:
        The remeshed surface of the attempt with the most faces within the limit.

    Raises:
        ValueError: The limit is below 4 faces, the surface has no area, or no attempt stays within the limit.

    Source: Botsch and Kobbelt, SGP 2004 (explicit isotropic remeshing), as implemented in MeshLab.
    """
    area = float(mesh.areas().sum())
    if max_faces < 4 or not area > 0:
        raise ValueError("remeshing needs a surface with an area and a limit of at least 4 faces")
    # Area of the surface in units of the wanted local edge length: smaller faces make it larger.
    wanted = area if sizes is None else float((mesh.areas() / sizes(mesh) ** 2).sum())
    edge = float(np.sqrt(4 * wanted / (np.sqrt(3) * max_faces)))
    best: Mesh | None = None
    prepared = _prepared(mesh, max_faces)
    short, long = 0.0, np.inf
    for _ in range(attempts):
        # Give a tolerance: MeshLab's default, 1 % of the bounding box, forbids the long edges of a small budget.
        candidate = _remesh(prepared, edge, 0.5 * edge)
        if sizes is not None:
            candidate = _graded(candidate, edge, sizes)
        if seen is not None:
            unseen = ~seen(candidate)
            candidate = _remesh(candidate, UNSEEN * edge, 0.5 * edge, unseen) if unseen.any() else candidate
        count = len(candidate.faces)
        if count > max_faces:
            short = max(short, edge)
        else:
            long = min(long, edge)
            if best is None or count > len(best.faces):
                best = candidate
        if best is not None and len(best.faces) > 0.97 * max_faces:
            break
        # Aim 1.5 % below the limit, because the count jumps slightly with the edge length. Once the limit is bracketed, bisect.
        edge *= float(np.sqrt(max(count, 1) / (0.985 * max_faces)))
        if not short < edge < long:
            edge = float(np.sqrt(short * long)) if short > 0 and np.isfinite(long) else max(1.1 * short, min(edge, 0.9 * long))
    if best is None:
        raise ValueError(f"the surface could not be remeshed within {max_faces} faces: the last attempt has {count}")
    return best


def _graded(mesh: Mesh, edge: float, sizes: Callable[[Mesh], Array]) -> Mesh:
    """Make faces of even size smaller or larger where `sizes` asks for it."""
    half_step = 2**0.25
    for ladder, sign in ((FINER, 1.0), (COARSER, -1.0)):
        for relative in ladder:
            chosen = sign * sizes(mesh) < sign * relative * half_step**sign
            if chosen.any():
                mesh = _remesh(mesh, relative * edge, 0.5 * edge, chosen, GRADING)
    return mesh


def _prepared(mesh: Mesh, max_faces: int) -> Mesh:
    """Return the surface without duplicate vertices and null faces, decimated if it has far more faces than needed."""
    import pymeshlab

    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32)))
    work.meshing_remove_duplicate_vertices()
    work.meshing_remove_null_faces()
    if len(mesh.faces) > DENSE * max_faces:
        work.meshing_decimation_quadric_edge_collapse(
            targetfacenum=DENSE * max_faces, preserveboundary=True, preservenormal=True, preservetopology=True
        )
    return _mesh(work)


def _remesh(mesh: Mesh, edge: float, tolerance: float, chosen: Array | None = None, iterations: int = ITERATIONS) -> Mesh:
    """Remesh to nearly equilateral faces, everywhere or in the chosen faces only.

    Args:
        mesh: Surface, m.
        edge: Edge length, m.
        tolerance: Largest distance of the new surface from the old one, m.
        chosen: Faces to remesh; None for all. [F] bool.
        iterations: Rounds of splitting, collapsing, flipping and smoothing.
    """
    import pymeshlab

    marks = np.ones(len(mesh.faces)) if chosen is None else chosen.astype(np.float64)
    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces.astype(np.int32), f_scalar_array=marks))
    # MeshLab keeps the option `selectedonly` for later calls in the process, so it is always on and faces are always selected.
    work.compute_selection_by_condition_per_face(condselect="fq > 0.5")
    work.meshing_isotropic_explicit_remeshing(
        iterations=iterations,
        targetlen=pymeshlab.PureValue(edge),
        featuredeg=FEATURE_DEG,
        selectedonly=True,
        checksurfdist=True,
        maxsurfdist=pymeshlab.PureValue(tolerance),
    )
    result = _mesh(work)
    keep = result.areas() > 1e-4 * edge**2
    return result if chosen is not None or keep.all() else Mesh(result.vertices, result.faces[keep])


def _mesh(work: pymeshlab.MeshSet) -> Mesh:
    """Return the current mesh of a MeshLab document, without unreferenced vertices."""
    work.meshing_remove_unreferenced_vertices()
    out = work.current_mesh()
    return Mesh(np.asarray(out.vertex_matrix(), np.float64), np.asarray(out.face_matrix(), np.int64))
