"""Convex hulls for contact: decomposition, a flat foot, few vertices, and room for the engine's margin."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from gsbridge.geometry import Array
from gsbridge.mesh.repair import depth_inside
from gsbridge.meshes import Mesh

_SEARCH = 60
"""Cuts that the search tries at each step; CoACD's own 150 take twice the time."""


def decompose(mesh: Mesh, *, concavity: float, most: int, seed: int) -> list[Array]:
    """Convex parts that together fill a closed mesh.

    Args:
        mesh: Watertight, m.
        concavity: Dents up to this depth may be filled, m.
        most: Largest number of parts; if they are too few, deeper dents are filled, too.
        seed: Random seed; equal seeds give equal parts.

    Returns:
        Vertices of each part. [N, 3] each.

    Source: Wei et al., "Approximate convex decomposition for 3D meshes with collision-aware concavity and tree search" (CoACD),
    2022.
    """
    import coacd

    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces.astype(np.int32)),
        threshold=concavity,
        real_metric=True,
        max_convex_hull=most,
        mcts_iterations=_SEARCH,
        preprocess_mode="off",  # it would resample the surface and lift the foot off the table; the mesh is closed already
        seed=seed,
    )
    return [np.asarray(vertices, dtype=np.float64) for vertices, _ in parts]


_CELLS, _DEEPEST, _FINER = 48, 30, 4
"""Sampling of `filled_depth`: `_CELLS` places along the body's longest side are compared first; then the search is refined
round the `_DEEPEST` deepest places, `_FINER` times at half the previous spacing."""


def filled_depth(hulls: list[Array], solid: Mesh) -> float:
    """How deep hulls fill the free space of a body: the largest distance from the body of a place that is in a hull only, m.

    A filled dent counts with its depth, a filled slot with half of its width. The result is 0 if the hulls fill nothing but the
    body.

    Args:
        hulls: Vertices of each hull, body frame, m. [N, 3] each.
        solid: Watertight, body frame, m.
    """
    equations = [ConvexHull(hull).equations for hull in hulls]

    def depths(places: Array) -> tuple[Array, Array]:
        """The places that lie in a hull, and the distance of each from the body, negative inside it. [N, 3], [N]."""
        held = np.zeros(len(places), bool)
        for planes in equations:
            held[~held] = (places[~held] @ planes[:, :3].T + planes[:, 3] < 0).all(1)
        places = places[held]
        return places, -depth_inside(solid, places).astype(np.float64) if len(places) else np.empty(0)

    low, high = solid.vertices.min(0), solid.vertices.max(0)
    step = float((high - low).max()) / _CELLS
    axes = [np.arange(a + 0.5 * step, b, step) for a, b in zip(low, high, strict=True)]
    places, found = depths(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))
    around = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for _ in range(_FINER):
        step *= 0.5
        deepest = places[np.argsort(-found, kind="stable")[:_DEEPEST]]
        places, found = depths((deepest[:, None] + step * around).reshape(-1, 3))
    return max(0.0, float(found.max())) if len(found) else 0.0


def seat(parts: list[Array], depth: float) -> list[Array]:
    """Give hulls a flat foot at z = 0: add the foot point of every vertex lower than `depth`, and drop vertices below z = 0.

    The object stood on the table when it was filmed, so its foot is flat as far as the camera can tell. The roughness of the
    reconstruction there would make the body rock.

    Args:
        parts: Vertices of each hull, body frame, m. [N, 3] each.
        depth: Height up to which a vertex belongs to the foot, m.
    """
    out = []
    for part in parts:
        low = part[part[:, 2] < depth]
        foot = low * [1.0, 1.0, 0.0]
        out.append(np.concatenate([part[part[:, 2] >= 0.0], foot]))
    return out


def simplify(points: Array, tolerance: float, most: int) -> Array:
    """Choose a few of a hull's vertices whose own hull comes within `tolerance` of it; the farthest are taken first.

    Points on z = 0 must be met within a tenth of the tolerance, as the body stands on them.

    Args:
        points: Points whose convex hull is simplified, m. [N, 3].
        tolerance: Largest distance of a left-out point from the result, m.
        most: Largest number of vertices; it overrules the tolerance.

    Returns:
        Vertices. [M, 3].
    """
    points = points[ConvexHull(points).vertices]
    chosen = list(dict.fromkeys(int(i) for axis in range(3) for i in (points[:, axis].argmin(), points[:, axis].argmax())))
    chosen += [int(np.linalg.norm(points - points[chosen].mean(0), axis=1).argmax())]
    weights = np.where(points[:, 2] == 0.0, 10.0, 1.0)
    for _ in range(len(points)):
        rank = np.linalg.matrix_rank(points[chosen] - points[chosen[0]], tol=1e-9)
        if rank == 3:
            break
        # The first extreme points may lie in one plane; then the point farthest from the plane is added.
        basis = np.linalg.svd(points[chosen] - points[chosen[0]])[2][rank:]
        chosen.append(int(np.linalg.norm((points - points[chosen[0]]) @ basis.T, axis=1).argmax()))
    while len(chosen) < min(most, len(points)):
        # The hull is built anew each time, because qhull's incremental mode fails on nearly flat additions.
        hull = ConvexHull(points[chosen])
        outside = weights * (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(1)
        worst = int(outside.argmax())
        if outside[worst] <= tolerance or worst in chosen:
            break
        chosen.append(worst)
    return points[sorted(chosen)]


def inset(points: Array, margin: float) -> tuple[Array, float]:
    """Move all faces of a convex hull inward, so that growing it by `margin` all round gives the original again.

    Bullet grows every convex mesh by its collision margin, so that bodies with exact hulls float that much above the table.

    Args:
        points: Vertices of the hull, m. [N, 3].
        margin: Distance, m.

    Returns:
        Vertices of the smaller hull [M, 3], and the distance by which its faces were moved, m: less than `margin` in hulls
        thinner than four margins, of whose thickness only half is taken.
    """
    equations = np.unique(np.round(ConvexHull(points).equations, 12), axis=0)
    normals, offsets = equations[:, :3], equations[:, 3]
    # Middle and radius of the largest ball inside (Chebyshev centre).
    best = linprog(
        [0.0, 0.0, 0.0, -1.0], np.c_[normals, np.ones(len(normals))], -offsets, bounds=[(None, None)] * 3 + [(0, None)]
    )
    assert best.x is not None  # the hull of any points holds their mean
    middle, radius = best.x[:3], best.x[3]
    moved = min(margin, 0.5 * radius)
    try:
        corners = HalfspaceIntersection(np.c_[normals, offsets + moved], middle).intersections
    except QhullError:  # a hull as thin as the rounding error has hardly any inside
        return points, 0.0
    return corners[ConvexHull(corners).vertices], float(moved)


def hull_mesh(points: Array) -> Mesh:
    """Closed mesh of the convex hull of points, in a fixed order. [N, 3]."""
    hull = ConvexHull(points)
    index = np.full(len(points), -1)
    index[hull.vertices] = np.arange(len(hull.vertices))
    faces = index[hull.simplices]
    vertices = points[hull.vertices]
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(vertices, faces.astype(np.int64))
