"""Where the object is: the sparse points that stand above the table, and the box round them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gsbridge.cameras import View
from gsbridge.errors import StageError
from gsbridge.geometry import Array
from gsbridge.photogrammetry.sparse import SparsePoints

_REACH = 0.8
"""Points farther than this share of the working distance from the point the cameras look at are the room, not the object."""
_LINK = 0.07
"""Points nearer to each other than this share of the working distance belong together."""

_TALL = 0.3
"""Points above this share of the object's height choose the object; lower ones join it only right beside them."""


@dataclass(frozen=True)
class Prompt:
    """What the sparse model says about the object.

    Args:
        points: Points on the object. [K, 3].
        table: Indices (into the sparse points) of points on the table, away from the object.
        low, high: Box that holds the object, with a margin; `low` lies on the table. [3] each.
        distance: Working distance: from the cameras to the point they look at.
    """

    points: Array
    table: Array
    low: Array
    high: Array
    distance: float

    def box_corners(self) -> Array:
        """Corners of the box. [8, 3]."""
        return np.array([[x, y, z] for x in (self.low[0], self.high[0]) for y in (self.low[1], self.high[1]) for z in
                         (self.low[2], self.high[2])])  # fmt: skip


def focus_point(views: Sequence[View]) -> Array:
    """Point nearest to the optical axes of all views, in the least-squares sense. [3]."""
    a = np.zeros((3, 3))
    b = np.zeros(3)
    for view in views:
        axis = view.cam_from_table[2, :3]
        across = np.eye(3) - np.outer(axis, axis)
        a += across
        b += across @ view.centre
    # Axes that are nearly parallel leave the depth open; a faint pull to the table at their mean keeps it defined.
    centre = np.mean([view.centre for view in views], axis=0)
    axis = np.mean([view.cam_from_table[2, :3] for view in views], axis=0)
    ground = centre + axis * (centre[2] / max(-axis[2], 0.05))
    weight = 1e-3 * len(views)
    return np.linalg.solve(a + weight * np.eye(3), b + weight * ground)


def _clusters(points: Array, radius: float) -> Array:
    """Label of the connected group of each point, linked within `radius`. [N, 3] -> [N]."""
    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    return connected_components(graph, directed=False)[1]


def find_object(views: Sequence[View], sparse: SparsePoints, height_share: float, min_points: int) -> Prompt:
    """Find the object among the sparse points: the group above the table that most cameras look at.

    Args:
        views: Posed views.
        sparse: Sparse model in the table frame.
        height_share: Least height of an object point, as a share of the working distance.
        min_points: Fewest object points.

    Returns:
        The prompt.

    Raises:
        StageError: Too few points stand above the table near the point the cameras look at.
    """
    focus = focus_point(views)
    distance = float(np.median([np.linalg.norm(view.centre - focus) for view in views]))
    points = sparse.points
    near = np.linalg.norm(points - focus, axis=1) < _REACH * distance
    height = points[:, 2]
    flat = near & (np.abs(height) < 0.02 * distance)
    # Spread of the table's own points; half of them may belong to the object's foot, which the median forgives.
    spread = 1.4826 * float(np.median(np.abs(height[flat]))) if flat.sum() >= 10 else 0.0
    threshold = min(max(height_share * distance, 4.0 * spread), 0.03 * distance)
    above = np.flatnonzero(near & (height > threshold))
    advice = (
        "Film closer, let the object fill a third of the picture and add light; a smooth, plain object needs the sam2 backend "
        "with weights (masks.backend, masks.sam2_weights)"
    )
    if len(above) < min_points:
        raise StageError("masks", f"only {len(above)} points stand above the table, {min_points} are needed", advice)
    # Wrong heights of the table reach over the threshold in places, so the tall points decide what the object is.
    central = above[np.linalg.norm(points[above, :2] - focus[:2], axis=1) < 0.3 * distance]
    height_of = float(np.percentile(height[central if len(central) >= min_points else above], 95))
    tall = above[height[above] > _TALL * height_of]
    labels = _clusters(points[tall], _LINK * distance)
    best, score = -1, -1.0
    for label in np.unique(labels):
        members = points[tall[labels == label]]
        away = np.linalg.norm(np.median(members, axis=0)[:2] - focus[:2]) / distance
        value = len(members) * np.exp(-((away / 0.25) ** 2))
        if value > score:
            best, score = int(label), value
    group = tall[labels == best]
    low_ones = np.setdiff1d(above, tall)
    if len(low_ones):
        beside = cKDTree(points[group, :2]).query(points[low_ones, :2])[0] < 0.02 * distance
        group = np.concatenate([group, low_ones[beside]])
    chosen = points[group]
    if len(chosen) > 30:
        # Lone points (wrong matches) would stretch the box: a good point has company.
        company = np.asarray(cKDTree(chosen).query(chosen, k=4)[0])[:, -1]
        chosen = chosen[company < max(4.0 * float(np.median(company)), 0.02 * distance)]
    if len(chosen) < min_points:
        raise StageError("masks", f"only {len(chosen)} points lie on the object, {min_points} are needed", advice)
    low, high = np.percentile(chosen, [1, 99], axis=0) if len(chosen) > 100 else (chosen.min(0), chosen.max(0))
    margin = 0.3 * float((high - low).max()) + 0.02 * distance
    low, high = low - margin, high + margin
    low[2] = 0.0
    inside = (points[:, 0] > low[0]) & (points[:, 0] < high[0]) & (points[:, 1] > low[1]) & (points[:, 1] < high[1])
    table = np.flatnonzero((np.abs(height) < 0.5 * threshold) & ~(inside & (height > 0.25 * threshold)))
    return Prompt(chosen, table, low, high, distance)
