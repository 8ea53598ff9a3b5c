"""The object on the table at the place the cameras look at: its sparse points, and its size."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gsbridge.geometry import Array

HEIGHT_SHARE = 0.008
"""Least height of an object's point above the table, as a share of the working distance."""

_REACH = 0.8
"""Points farther than this from the point the cameras look at, as a share of the working distance, are part of the room."""
_LINK = 0.07
"""Points nearer to each other than this, as a share of the working distance, belong together."""
_BESIDE = 0.02
"""Low points this near to the object, as a share of the working distance, are its foot."""
_TALL = 0.3
"""Points above this share of the object's height decide which group is the object; lower points are added to it afterwards."""
_AHEAD, _RIVAL = 0.12, 20
"""Another group of at least `_RIVAL` points may be the object that was meant if it stands nearer to the place that the cameras
look at, by more than `_AHEAD` of the working distance."""
_HIDDEN = 2.0
"""Low points are a foot, and no bumps of the table, if their number is more than this many times that of the table's points."""


@dataclass(frozen=True)
class Standing:
    """The object among sparse points in the table frame.

    Args:
        members: Indices of the object's points. [K].
        threshold: Height from which on a point stands above the table.
        above: Number of points above `threshold` near the place the cameras look at.
        nearer: Number of points of the largest other group that stands nearer to that place (see `_AHEAD`); 0 if there is none.
    """

    members: Array
    threshold: float
    above: int
    nearer: int = 0


def _clusters(points: Array, radius: float) -> Array:
    """Label of the connected group of each point, linked within `radius`. [N, 3] -> [N]."""
    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    return connected_components(graph, directed=False)[1]


def find_standing(
    points: Array, focus: Array, distance: float, height_share: float = HEIGHT_SHARE, min_points: int = 5
) -> Standing:
    """Find the group of points above the table that most cameras look at, and its foot.

    Args:
        points: Sparse points in the table frame, z up, any unit. [N, 3].
        focus: Point that the cameras look at. [3].
        distance: Working distance, from the cameras to that point, in the unit of `points`.
        height_share: Least height of an object's point, as a share of the working distance.
        min_points: Least number of points of an object.

    Returns:
        The object; it has no members if fewer than `min_points` points stand above the table.
    """
    near = np.linalg.norm(points - focus, axis=1) < _REACH * distance
    height = points[:, 2]
    flat = near & (np.abs(height) < 0.02 * distance)
    # Spread of the table's own points; the median tolerates that up to half of them belong to the object's foot.
    spread = 1.4826 * float(np.median(np.abs(height[flat]))) if flat.sum() >= 10 else 0.0
    threshold = min(max(height_share * distance, 4.0 * spread), 0.03 * distance)
    above = np.flatnonzero(near & (height > threshold))
    if len(above) < min_points:
        return Standing(np.zeros(0, dtype=int), threshold, len(above))
    # Wrong heights of the table exceed the threshold in places, so only tall points decide which group is the object.
    central = above[np.linalg.norm(points[above, :2] - focus[:2], axis=1) < 0.3 * distance]
    height_of = float(np.percentile(height[central if len(central) >= min_points else above], 95))
    tall = above[height[above] > _TALL * height_of]
    labels = _clusters(points[tall], _LINK * distance)
    groups = [points[tall[labels == label]] for label in range(labels.max() + 1)]
    counts = np.array([len(members) for members in groups])
    away = np.array([np.linalg.norm(np.median(members, axis=0)[:2] - focus[:2]) for members in groups]) / distance
    best = int(np.argmax(counts * np.exp(-((away / 0.25) ** 2))))
    between = counts[(away < away[best] - _AHEAD) & (counts >= _RIVAL)]
    group = _with_foot(points, tall[labels == best], np.setdiff1d(above, tall), near & (np.abs(height) <= threshold), distance)
    chosen = points[group]
    if len(chosen) > 30:
        # Isolated points are wrong matches and would stretch the box; a good point has others nearby.
        company = np.asarray(cKDTree(chosen).query(chosen, k=4)[0])[:, -1]
        group = group[company < max(4.0 * float(np.median(company)), 0.02 * distance)]
    return Standing(group, threshold, len(above), int(between.max(initial=0)))


def _with_foot(points: Array, group: Array, low: Array, table: Array, distance: float) -> Array:
    """Add to a group the low points of its foot: those that connect to it and hide the table, and all right beside them.

    Bumps of the table, where its measured heights are wrong, lie among other points of the table; a foot or plinth covers the
    table, so that few points of the table lie among its own.

    Args:
        points: All points. [N, 3].
        group, low: Indices of the group and of the low points that may join it. [K], [L].
        table: Points on the table. [N] bool.
        distance: Working distance.

    Returns:
        Indices of the group with its foot. [M].
    """
    if len(low) == 0:
        return group
    reach = _BESIDE * distance
    flat = cKDTree(points[low, :2])
    here = flat.query_ball_point(points[low, :2], reach, return_length=True)
    under = cKDTree(points[table, :2]).query_ball_point(points[low, :2], reach, return_length=True) if table.any() else 0 * here
    firm = low[(here >= 4) & (here > _HIDDEN * under)]
    if len(firm):
        both = np.concatenate([group, firm])
        labels = _clusters(points[both], 1.5 * reach)
        group = both[np.isin(labels, np.unique(labels[: len(group)]))]
    rest = np.setdiff1d(low, group)
    if len(rest) == 0:
        return group
    beside = cKDTree(points[group, :2]).query(points[rest, :2])[0] < reach
    return np.concatenate([group, rest[beside]])


def box_sides(points: Array, beyond: float = 0.0) -> Array:
    """Sides of the upright box with the smallest footprint round points: footprint, height. [N, 3] -> [3].

    Args:
        points: Points on an object, z up, z = 0 on the table, any unit. [N, 3].
        beyond: Percentage of the points that may lie beyond each side. Above 0, no single point decides a side, so that the
            same object filmed again has nearly the same sides.
    """
    flat = points[:, :2] - points[:, :2].mean(0)
    _, sides, angle = cv2.minAreaRect(np.ascontiguousarray(flat, dtype=np.float32))
    if beyond == 0.0:
        return np.array([*sides, np.ptp(np.append(points[:, 2], 0.0))])
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    low, high = np.percentile(flat @ np.array([[c, -s], [s, c]]), [beyond, 100 - beyond], axis=0)
    return np.array([*(high - low), max(float(np.percentile(points[:, 2], 100 - beyond)), 0.0)])
