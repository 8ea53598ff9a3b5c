"""The plane that supports the object, found among sparse points without knowing the scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.geometry import Array, fit_plane

BELOW = 4.0
"""How much a point below a plane counts against it, as a multiple of a point on it."""

LINK = 0.04
"""Distance within which two points belong together, as a share of the cameras' distance."""


@dataclass(frozen=True)
class Attention:
    """Where the cameras look.

    Args:
        point: Point nearest to all optical axes. [3].
        distance: Median distance of the cameras from it: the scene's own unit of length.
        up: Mean upward direction of the images. [3].
        centres: Camera centres. [N, 3].
    """

    point: Array
    distance: float
    up: Array
    centres: Array


@dataclass(frozen=True)
class Plane:
    """Table plane `normal . x = offset`, the cameras on the positive side.

    Args:
        normal: Unit normal. [3].
        offset: Distance of the plane from the origin along the normal.
        inliers: Which points lie on it. [N] bool.
        threshold: Distance within which a point lies on it, scene units.
        residual: Root mean square distance of the inliers, scene units.
    """

    normal: Array
    offset: float
    inliers: Array
    threshold: float
    residual: float

    def heights(self, points: Array) -> Array:
        """Signed distance of points, positive towards the cameras. [..., 3] -> [...]."""
        return np.asarray(points) @ self.normal - self.offset


def attention(cam_from_world: Array) -> Attention:
    """Where a set of cameras looks. [N, 4, 4]."""
    poses = np.asarray(cam_from_world, dtype=np.float64)
    rotations = poses[:, :3, :3]
    centres = -np.einsum("nji,nj->ni", rotations, poses[:, :3, 3])
    axes = rotations[:, 2]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # Nearly parallel axes have no common point; the small term then keeps it close to the cameras' mean look.
    lhs = across.sum(0) + 1e-6 * len(poses) * np.eye(3)
    point = np.linalg.solve(lhs, np.einsum("nij,nj->i", across, centres) + 1e-6 * len(poses) * centres.mean(0))
    up = -rotations[:, 1].mean(0)
    distance = float(np.median(np.linalg.norm(centres - point, axis=1)))
    return Attention(point, distance, up / max(np.linalg.norm(up), 1e-9), centres)


def find_table(points: Array, looks: Attention, *, threshold: float, seed: int, trials: int = 2000) -> Plane | None:
    """Find the supporting plane by RANSAC.

    A plane scores by its points near the place the cameras look at, so that a wall or the floor behind loses; all cameras must
    be on one side, hardly any point below it near that place, and the images' up direction must not point into it.

    Args:
        points: Sparse points, arbitrary scale. [N, 3].
        looks: Where the cameras look.
        threshold: Inlier distance as a share of the cameras' distance.
        seed: Random seed.
        trials: Planes to try.

    Returns:
        The plane, refitted to its inliers; None where no plane fits.
    """
    pts = np.asarray(points, dtype=np.float64)
    if len(pts) < 20:
        return None
    limit = threshold * looks.distance
    away = np.linalg.norm(pts - looks.point, axis=1) / (0.5 * looks.distance)
    weights = np.exp(-0.5 * away**2) + 1e-4
    rng = np.random.default_rng(seed)
    sample = pts
    sample_weights = weights
    if len(pts) > 8000:
        pick = rng.choice(len(pts), 8000, replace=False, p=weights / weights.sum())
        sample, sample_weights = pts[pick], np.full(8000, 1.0)
    chance = sample_weights / sample_weights.sum()
    best: tuple[float, Array, float] | None = None
    for _ in range(trials):
        a, b, c = sample[rng.choice(len(sample), 3, p=chance)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1e-12:
            continue
        normal /= length
        score, normal, offset = _score(sample, sample_weights, normal, float(normal @ a), looks, limit)
        if best is None or score > best[0]:
            best = (score, normal, offset)
    if best is None or best[0] <= 0.0:
        return None
    return _refit(pts, best[1], best[2], limit, looks)


def _score(
    points: Array, weights: Array, normal: Array, offset: float, looks: Attention, limit: float
) -> tuple[float, Array, float]:
    """Score of a plane and the plane itself, turned towards the cameras."""
    sides = looks.centres @ normal - offset
    if np.median(sides) < 0:
        normal, offset, sides = -normal, -offset, -sides
    if np.quantile(sides, 0.05) <= 0 or looks.up @ normal < 0.1:
        return 0.0, normal, offset
    heights = points @ normal - offset
    support = float(weights[np.abs(heights) < limit].sum())
    below = float(weights[heights < -3.0 * limit].sum())
    # Points below a table are mirror images and mismatches; a plane through an object's top has all the table below it.
    return support - BELOW * below, normal, offset


def _refit(points: Array, normal: Array, offset: float, limit: float, looks: Attention) -> Plane | None:
    """Least-squares plane through the inliers, repeated until they settle."""
    inliers = np.abs(points @ normal - offset) < limit
    for _ in range(20):
        if inliers.sum() < 10:
            return None
        # A lasting outer limit and a robust inner one: the spread of a good table is far below the search threshold.
        heights = points[inliers] @ normal - offset
        spread = 1.4826 * float(np.median(np.abs(heights - np.median(heights))))
        fresh_limit = min(limit, max(3.0 * spread, 0.1 * limit))
        normal_new, offset_new = fit_plane(points[inliers])
        if np.median(looks.centres @ normal_new - offset_new) < 0:
            normal_new, offset_new = -normal_new, -offset_new
        fresh = np.abs(points @ normal_new - offset_new) < fresh_limit
        normal, offset = normal_new, offset_new
        if (fresh == inliers).all():
            break
        inliers = fresh
    residual = float(np.sqrt(np.mean((points[inliers] @ normal - offset) ** 2)))
    return Plane(normal, offset, inliers, limit, residual)


def object_points(points: Array, plane: Plane, looks: Attention) -> Array:
    """Points of what stands on the table where the cameras look: the heaviest cluster above the plane. [N] bool.

    Args:
        points: Sparse points. [N, 3].
        plane: The table.
        looks: Where the cameras look.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    heights = plane.heights(points)
    ceiling = 0.8 * float(np.quantile(plane.heights(looks.centres), 0.05))
    foot = looks.point - plane.heights(looks.point) * plane.normal
    flat = points - heights[:, None] * plane.normal
    away = np.linalg.norm(flat - foot, axis=1) / looks.distance
    chosen = (heights > 2.0 * plane.threshold) & (heights < ceiling) & (away < 0.5)
    members = np.flatnonzero(chosen)
    out = np.zeros(len(points), dtype=bool)
    if len(members) < 5:
        out[members] = True
        return out
    tree = cKDTree(points[members])
    reach = LINK * looks.distance
    # Stragglers bridge an object to the noise over the table; a point needs company to belong to anything.
    company = tree.query_ball_point(points[members], reach, return_length=True)
    dense = company >= max(3.0, 0.15 * float(np.quantile(company, 0.9)))
    if dense.sum() >= 5:
        members = members[dense]
        tree = cKDTree(points[members])
    pairs = tree.query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(members), len(members)))
    _, labels = connected_components(graph, directed=False)
    weights = np.exp(-0.5 * (away[members] / 0.15) ** 2)
    scores = np.bincount(labels, weights=weights)
    out[members[labels == int(scores.argmax())]] = True
    return out
