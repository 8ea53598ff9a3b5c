"""The plane that supports the object, found among sparse points without knowing the scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.geometry import Array, fit_plane

BELOW = 4.0
"""How much a point below a plane counts against it, as a multiple of a point on it."""

SIDES = {"top": (0.0, -1.0, 0.0), "right": (1.0, 0.0, 0.0), "bottom": (0.0, 1.0, 0.0), "left": (-1.0, 0.0, 0.0)}
"""Direction of each side of a photo in its camera's axes."""

AGAINST_UP = 0.5
"""Weight of a plane that the images' up direction points into or along, beside one that it rises from."""


@dataclass(frozen=True)
class Attention:
    """Direction and place that the cameras look at.

    Args:
        point: Point nearest to all optical axes. [3].
        distance: Median distance of the cameras from it: the scene's own unit of length.
        up: Mean upward direction of the images; shorter than 1 the less they agree on it. [3].
        centres: Camera centres. [N, 3].
        named: The user has said which side of the photos is up, so that a plane against it is refused.
    """

    point: Array
    distance: float
    up: Array
    centres: Array
    named: bool = False


@dataclass(frozen=True)
class Plane:
    """Table plane `normal . x = offset`, the cameras on the positive side.

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
    """Point that a set of cameras looks at, with its distance and the direction that is up.

    Args:
        cam_from_world: Poses. [N, 4, 4].
        up: Side of the photos that is up in the scene, one of `SIDES`; None takes their top for a hint only.
    """
    poses = np.asarray(cam_from_world, dtype=np.float64)
    rotations = poses[:, :3, :3]
    centres = -np.einsum("nji,nj->ni", rotations, poses[:, :3, 3])
    axes = rotations[:, 2]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # Nearly parallel axes have no common point; the small term then keeps it close to the cameras' mean look.
    lhs = across.sum(0) + 1e-6 * len(poses) * np.eye(3)
    point = np.linalg.solve(lhs, np.einsum("nij,nj->i", across, centres) + 1e-6 * len(poses) * centres.mean(0))
    side = np.array(SIDES[up or "top"])
    distance = float(np.median(np.linalg.norm(centres - point, axis=1)))
    return Attention(point, distance, np.einsum("nji,j->i", rotations, side) / len(poses), centres, up is not None)


def find_table(points: Array, looks: Attention, *, threshold: float, seed: int, trials: int = 2000) -> Plane | None:
    """Find the supporting plane by RANSAC.

    A plane scores by its points near the place the cameras look at, so that a wall or the floor behind loses; all cameras must
    be on one side and hardly any point below it near that place. The images' up direction decides between planes of like
    support only: photos may be stored turned, or be taken from straight above. Where the user has named it, it must not point
    into the plane.

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
    """Why `find_table` finds nothing: what speaks against the plane with the most points, in one clause.

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
    """Score of a plane and the plane itself, turned towards the cameras."""
    sides = looks.centres @ normal - offset
    if np.median(sides) < 0:
        normal, offset, sides = -normal, -offset, -sides
    against = looks.up @ normal < 0.1
    if np.quantile(sides, 0.05) <= 0 or (against and looks.named):
        return 0.0, normal, offset
    heights = points @ normal - offset
    support = float(weights[np.abs(heights) < limit].sum())
    below = float(weights[heights < -3.0 * limit].sum())
    # Points below a table are mirror images and mismatches; a plane through an object's top has all the table below it.
    score = support - BELOW * below
    return score * (AGAINST_UP if against and score > 0 else 1.0), normal, offset


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
