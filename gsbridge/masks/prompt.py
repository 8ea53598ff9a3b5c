"""Where the object is: the sparse points that stand above the table, and the box round them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.cameras import View
from gsbridge.errors import StageError
from gsbridge.geometry import Array
from gsbridge.photogrammetry.sparse import SparsePoints
from gsbridge.photogrammetry.standing import find_standing


@dataclass(frozen=True)
class Prompt:
    """Points and box of the object, from the sparse model.

    Args:
        points: Points on the object. [K, 3].
        table: Indices (into the sparse points) of points on the table, away from the object. [M].
        low, high: Box that holds the object, with a margin; `low` lies on the table. [3] each.
        distance: Working distance, from the cameras to the point they look at, m.
        nearer: Number of points of another thing that stands nearer to the point the cameras look at; 0 if there is none.
    """

    points: Array
    table: Array
    low: Array
    high: Array
    distance: float
    nearer: int = 0

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
    # Nearly parallel axes do not determine the depth; a weak pull to the point where their mean axis meets the table does.
    centre = np.mean([view.centre for view in views], axis=0)
    axis = np.mean([view.cam_from_table[2, :3] for view in views], axis=0)
    ground = centre + axis * (centre[2] / max(-axis[2], 0.05))
    weight = 1e-3 * len(views)
    return np.linalg.solve(a + weight * np.eye(3), b + weight * ground)


def working_distance(views: Sequence[View], focus: Array) -> float:
    """Median distance of the views from the point they look at. [3]."""
    return float(np.median([np.linalg.norm(view.centre - focus) for view in views]))


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
    distance = working_distance(views, focus)
    points = sparse.points
    found = find_standing(points, focus, distance, height_share, min_points)
    advice = (
        "Film closer, let the object fill a third of the picture and add light; a smooth, plain object stands out from a table "
        "with a pattern, such as a cloth"
    )
    if found.above < min_points:
        raise StageError("masks", f"only {found.above} points stand above the table, {min_points} are needed", advice)
    chosen, height, threshold = points[found.members], points[:, 2], found.threshold
    if len(chosen) < min_points:
        raise StageError("masks", f"only {len(chosen)} points lie on the object, {min_points} are needed", advice)
    low, high = np.percentile(chosen, [1, 99], axis=0) if len(chosen) > 100 else (chosen.min(0), chosen.max(0))
    margin = 0.3 * float((high - low).max()) + 0.02 * distance
    low, high = low - margin, high + margin
    low[2] = 0.0
    inside = (points[:, 0] > low[0]) & (points[:, 0] < high[0]) & (points[:, 1] > low[1]) & (points[:, 1] < high[1])
    table = np.flatnonzero((np.abs(height) < 0.5 * threshold) & ~(inside & (height > 0.25 * threshold)))
    return Prompt(chosen, table, low, high, distance, found.nearer)
