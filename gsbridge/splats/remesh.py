"""Even triangles for the binding: splats take their shape from faces, so slivers make bad splats."""

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
"""Iterations of each step from one size to the next: the faces are even already."""

FEATURE_DEG = 60.0
"""Edges sharper than this stay where they are."""

UNSEEN = 3.0
"""Edge length where no camera looks, relative to the rest."""

FINER, COARSER = (0.71, 0.5, 0.35, 0.25), (1.41, 2.0, 2.83)
"""Edge lengths in use where sizes are asked for, each reached from the one before: MeshLab knows one length at a time."""

DENSE = 4
"""A mesh with more faces than this many times the budget is decimated first: that is faster and changes nothing visible."""


def remesh_isotropic(
    mesh: Mesh,
    max_faces: int,
    *,
    seen: Callable[[Mesh], Array] | None = None,
    sizes: Callable[[Mesh], Array] | None = None,
    attempts: int = 8,
) -> Mesh:
    """Rebuild a surface with at most `max_faces` nearly equilateral faces, of one size or of sizes asked for.

    Open meshes keep their border. Colours are dropped: splats learn their own.

    Args:
        mesh: Surface, table frame, m.
        max_faces: Upper limit of the number of faces.
        seen: Tells which faces of a mesh any camera sees; the others get larger triangles, as no photo will miss detail there.
        sizes: Relative edge length at each face of a mesh; it is met in steps of a square root of two. [F].
        attempts: How often the edge length is corrected to meet the limit.

    Returns:
        The remeshed surface; its number of faces is as near to the limit as the attempts come, from below.

    Raises:
        ValueError: The limit is below 4 faces, or the surface has no area.

    Source: Botsch and Kobbelt, SGP 2004 (explicit isotropic remeshing), as implemented in MeshLab.
    """
    area = float(mesh.areas().sum())
    if max_faces < 4 or not area > 0:
        raise ValueError("remeshing needs a surface with an area and a limit of at least 4 faces")
    # In units of the wanted edge, smaller faces make the surface larger.
    wanted = area if sizes is None else float((mesh.areas() / sizes(mesh) ** 2).sum())
    edge = float(np.sqrt(4 * wanted / (np.sqrt(3) * max_faces)))
    best: Mesh | None = None
    prepared = _prepared(mesh, max_faces)
    short, long = 0.0, np.inf
    for _ in range(attempts):
        # MeshLab's own tolerance, 1 % of the bounding box, forbids the large edges of a small budget.
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
        # Aim 1.5 % below the limit, as the count jumps a little with the edge length; halve once it lies between two lengths.
        edge *= float(np.sqrt(max(count, 1) / (0.985 * max_faces)))
        if not short < edge < long:
            edge = float(np.sqrt(short * long)) if short > 0 and np.isfinite(long) else max(1.1 * short, min(edge, 0.9 * long))
    if best is None:
        raise ValueError(f"the surface could not be remeshed within {max_faces} faces: the last attempt has {count}")
    return best


def _graded(mesh: Mesh, edge: float, sizes: Callable[[Mesh], Array]) -> Mesh:
    """Faces of even size made smaller and larger where that is asked for."""
    half_step = 2**0.25
    for ladder, sign in ((FINER, 1.0), (COARSER, -1.0)):
        for relative in ladder:
            chosen = sign * sizes(mesh) < sign * relative * half_step**sign
            if chosen.any():
                mesh = _remesh(mesh, relative * edge, 0.5 * edge, chosen, GRADING)
    return mesh


def _prepared(mesh: Mesh, max_faces: int) -> Mesh:
    """The surface without faulty faces, and with no more faces than is useful."""
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
    """Nearly equilateral faces, everywhere or in the chosen faces only.

    Args:
        mesh: Surface.
        edge: Edge length, m.
        tolerance: How far the new surface may stray from the old one, m.
        chosen: Faces to work on, None for all. [F] bool.
        iterations: Rounds of splitting, collapsing, flipping and smoothing.
    """
    import pymeshlab

    marks = np.ones(len(mesh.faces)) if chosen is None else chosen.astype(np.float64)
    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces.astype(np.int32), f_scalar_array=marks))
    # MeshLab keeps "selected only" for later calls in the process, so it is always on and the selection made here.
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
    """The mesh of a MeshLab document."""
    work.meshing_remove_unreferenced_vertices()
    out = work.current_mesh()
    return Mesh(np.asarray(out.vertex_matrix(), np.float64), np.asarray(out.face_matrix(), np.int64))
