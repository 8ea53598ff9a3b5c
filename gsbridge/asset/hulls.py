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
        concavity: Dents up to this depth are filled, m.
        most: Parts, at most; deeper dents are then filled too.
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
"""Places along the longest side of a body at which its hulls are compared with it, how many of the deepest are looked at again,
and how often the distance between places is halved there."""


def filled_depth(hulls: list[Array], solid: Mesh) -> float:
    """How far hulls reach into what a body leaves free: the distance of their deepest inner place from its surface, m.

    A dent that is filled counts with its depth, a slot with half of its width. 0 where the hulls hold nothing but the body.

    Args:
        hulls: Vertices of each hull, body frame, m. [N, 3] each.
        solid: Watertight, body frame, m.
    """
    equations = [ConvexHull(hull).equations for hull in hulls]

    def depths(places: Array) -> tuple[Array, Array]:
        """Those places that a hull holds, and how far each is from the body, negative inside. [N, 3], [N]."""
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
    """Give hulls a flat foot at z = 0: vertices lower than `depth` are joined by their foot points, and none lies below.

    The object stood on the table when it was filmed, so its foot is flat as far as the camera can tell; the reconstruction's
    roughness there would make the body rock.

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
    """A few of a hull's vertices whose own hull lies within `tolerance` of it, farthest first.

    Points on z = 0 are kept closely (a tenth of the tolerance), as the body stands on them.

    Args:
        points: Points whose convex hull is meant, m. [N, 3].
        tolerance: Largest distance of a left-out point from the result, m.
        most: Vertices, at most (the tolerance then gives way).

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
        # The first extremes can lie in one plane; take the point farthest out of it.
        basis = np.linalg.svd(points[chosen] - points[chosen[0]])[2][rank:]
        chosen.append(int(np.linalg.norm((points - points[chosen[0]]) @ basis.T, axis=1).argmax()))
    while len(chosen) < min(most, len(points)):
        # Built anew each time: qhull's incremental mode gives up on nearly flat additions.
        hull = ConvexHull(points[chosen])
        outside = weights * (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(1)
        worst = int(outside.argmax())
        if outside[worst] <= tolerance or worst in chosen:
            break
        chosen.append(worst)
    return points[sorted(chosen)]


def inset(points: Array, margin: float) -> tuple[Array, float]:
    """A convex hull with all its faces moved inward, so that a rounding of `margin` all round fills the original again.

    Bullet grows every convex mesh by its collision margin: bodies whose hulls are exact float that much above the table.

    Args:
        points: Vertices of the hull, m. [N, 3].
        margin: Distance, m.

    Returns:
        Vertices of the smaller hull [M, 3], and by how much it was moved: less than `margin` in hulls thinner than four of it,
        where only half of the thickness is taken.
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
    except QhullError:  # a hull as thin as rounding has no inside to speak of
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
