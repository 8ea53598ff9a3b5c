"""The plane that supports the object, found among sparse points without knowing the scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.geometry import Array, fit_plane

BELOW = 4.0
"""Weight of a point below a plane, which counts against it, relative to a point on the plane."""

SIDES = {"top": (0.0, -1.0, 0.0), "right": (1.0, 0.0, 0.0), "bottom": (0.0, 1.0, 0.0), "left": (-1.0, 0.0, 0.0)}
"""Direction of each side of a photo in its camera's axes."""

AGAINST_UP = 0.5
"""Factor on the score of a plane if the images' up direction points into it or along it instead of away from it."""


@dataclass(frozen=True)
class Attention:
    """Direction and place that the cameras look at.

    Args:
        point: Point nearest to all optical axes. [3].
        distance: Median distance of the cameras from `point`, used as the scene's unit of length.
        up: Mean upward direction of the images; the less they agree, the shorter it is. [3].
        centres: Camera centres. [N, 3].
        named: Whether the user has said which side of the photos is up; a plane that contradicts this is refused.
    """

    point: Array
    distance: float
    up: Array
    centres: Array
    named: bool = False


@dataclass(frozen=True)
class Plane:
    """Table plane `normal . x = offset`, with the cameras on its positive side.

    Args:
        normal: Unit normal. [3].
        offset: Distance of the plane from the origin along the normal.
        inliers: Points that lie on the plane. [N] bool.
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


def attention(cam_from_world: Array, up: str | None = None) -> Attention:
    """Point that a set of cameras looks at, with its distance and the upward direction.

    Args:
        cam_from_world: Poses. [N, 4, 4].
        up: Side of the photos that is up in the scene, one of `SIDES`; None takes their top, as a hint only.
    """
    poses = np.asarray(cam_from_world, dtype=np.float64)
    rotations = poses[:, :3, :3]
    centres = -np.einsum("nji,nj->ni", rotations, poses[:, :3, 3])
    axes = rotations[:, 2]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # Nearly parallel axes determine no common point; the small term then keeps the point close to the cameras' mean centre.
    lhs = across.sum(0) + 1e-6 * len(poses) * np.eye(3)
    point = np.linalg.solve(lhs, np.einsum("nij,nj->i", across, centres) + 1e-6 * len(poses) * centres.mean(0))
    side = np.array(SIDES[up or "top"])
    distance = float(np.median(np.linalg.norm(centres - point, axis=1)))
    return Attention(point, distance, np.einsum("nji,j->i", rotations, side) / len(poses), centres, up is not None)


def find_table(points: Array, looks: Attention, *, threshold: float, seed: int, trials: int = 2000) -> Plane | None:
    """Find the supporting plane by RANSAC.

    A plane scores by its points near the place the cameras look at, so that a wall or the floor behind loses. All cameras must
    be on one side of it, and hardly any point near that place may lie below it. The images' up direction only decides between
    planes with similar support, because photos may be stored rotated or be taken from straight above. If the user has named the
    upward side, that direction must not point into the plane.

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


def why_no_table(points: Array, looks: Attention, *, threshold: float, seed: int) -> str:
    """Explain in one clause why `find_table` finds nothing: what disqualifies the plane with the most points.

    Args:
        points: Sparse points, arbitrary scale. [N, 3].
        looks: Where the cameras look.
        threshold: Inlier distance as a share of the cameras' distance.
        seed: Random seed.
    """
    pts = np.asarray(points, dtype=np.float64)
    if len(pts) < 20:
        return "20 are needed"
    rng = np.random.default_rng(seed)
    limit = threshold * looks.distance
    most, normal, offset = 0, np.zeros(3), 0.0
    for _ in range(500):
        a, b, c = pts[rng.choice(len(pts), 3)]
        cross = np.cross(b - a, c - a)
        length = np.linalg.norm(cross)
        if length < 1e-12:
            continue
        count = int((np.abs((pts - a) @ cross / length) < limit).sum())
        if count > most:
            most, normal, offset = count, cross / length, float(a @ cross / length)
    sides = looks.centres @ normal - offset
    if np.median(sides) < 0:
        normal, offset, sides = -normal, -offset, -sides
    text = f"the plane with most of them holds {most}, but "
    below = int((pts @ normal - offset < -3.0 * limit).sum())
    if np.quantile(sides, 0.05) <= 0:
        return text + f"{int((sides <= 0).sum())} of {len(sides)} cameras stand on its other side"
    if looks.named and looks.up @ normal < 0.1:
        return text + "it does not face the side that `up` names"
    if BELOW * below >= most:
        return text + f"{below} lie below it"
    return text + "they do not settle on one plane"


def _score(
    points: Array, weights: Array, normal: Array, offset: float, looks: Attention, limit: float
) -> tuple[float, Array, float]:
    """Score of a plane, and its normal and offset with the normal turned towards the cameras."""
    sides = looks.centres @ normal - offset
    if np.median(sides) < 0:
        normal, offset, sides = -normal, -offset, -sides
    against = looks.up @ normal < 0.1
    if np.quantile(sides, 0.05) <= 0 or (against and looks.named):
        return 0.0, normal, offset
    heights = points @ normal - offset
    support = float(weights[np.abs(heights) < limit].sum())
    below = float(weights[heights < -3.0 * limit].sum())
    # Only reflections and mismatches lie below a table, so few points; a plane through an object's top has all the table below.
    score = support - BELOW * below
    return score * (AGAINST_UP if against and score > 0 else 1.0), normal, offset


def _refit(points: Array, normal: Array, offset: float, limit: float, looks: Attention) -> Plane | None:
    """Fit a least-squares plane to the inliers, and repeat until the inliers no longer change."""
    inliers = np.abs(points @ normal - offset) < limit
    for _ in range(20):
        if inliers.sum() < 10:
            return None
        # The limit follows the inliers' own spread, far below the search threshold on a good table, and never exceeds that.
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
