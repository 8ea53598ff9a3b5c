"""Distance between two paths in space, whatever the time they take.

Both paths are cut into pieces of the same length, so that a hand that waits counts no more than one that passes, and are then
laid on one another by dynamic time warping: each point of one path is matched with at least one of the other, in order, such
that the mean distance of the matched points is smallest. That mean, in the paths' unit, is the distance. A step along both
paths weighs twice as much as a step along one, so that every piece of either path has the same weight.

The distance is symmetric, zero for two runs along the same curve at any speed, and the offset of two straight paths side by
side. Where one path ends early or goes somewhere else, the part of the other that it misses is matched with its nearest point
that keeps the order. For two paths from the same point along the same straight line, of lengths L > l, the distance is
(L - l)^2 / (2 (L + l)).

Source: Sakoe and Chiba, Dynamic programming algorithm optimization for spoken word recognition, 1978 (symmetric form, no slope
constraint).
"""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array

SPACING = 0.003
"""Length of a piece, m. The distance of paths that cross is wrong by less than half of it, that of parallel paths is exact."""


def resample(path: Array, spacing: float = SPACING) -> Array:
    """Resample a path at equal distances; a path shorter than half of `spacing` becomes its first point.

    Args:
        path: Points of the path, m, N >= 1. [N, D].
        spacing: Distance along the path, m, rounded so that it divides the length.

    Returns:
        Points, m, [M, D]; where M > 1, the first and the last are the path's own.

    Raises:
        ValueError: The path is empty or not finite.
    """
    path = np.asarray(path, dtype=np.float64)
    if path.ndim != 2 or len(path) == 0 or not np.isfinite(path).all():
        raise ValueError(f"a path of the shape {path.shape} is empty or not finite")
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    # Drop repeated points: the interpolation needs strictly increasing lengths along the path.
    path, steps = path[np.concatenate([[True], steps > 0])], steps[steps > 0]
    along = np.concatenate([[0.0], np.cumsum(steps)])
    pieces = round(along[-1] / spacing)
    wanted = np.linspace(0.0, along[-1], pieces + 1) if pieces else along[:1]
    return np.stack([np.interp(wanted, along, column) for column in path.T], axis=1)


def warped_distance(one: Array, two: Array) -> float:
    """Smallest weighted mean distance of points matched in order; see the module.

    Args:
        one: Points of the first path. [N, D].
        two: Points of the second path. [M, D].

    Returns:
        The distance, in the unit of the points.
    """
    apart = np.linalg.norm(np.asarray(one)[:, None] - np.asarray(two)[None], axis=-1)
    rows, columns = apart.shape
    cost = np.full((rows + 1, columns + 1), np.inf)
    cost[0, 0] = 0.0
    # The entries of an antidiagonal do not depend on each other, so each one is computed at once.
    for diagonal in range(rows + columns - 1):
        i = np.arange(max(0, diagonal - columns + 1), min(rows, diagonal + 1))
        j = diagonal - i
        both, single = cost[i, j] + 2 * apart[i, j], np.minimum(cost[i, j + 1], cost[i + 1, j]) + apart[i, j]
        cost[i + 1, j + 1] = np.minimum(both, single)
    return float(cost[rows, columns] / (rows + columns))


def path_distance(one: Array, two: Array) -> float:
    """Distance between two paths, m. [N, D], [M, D].

    Raises:
        ValueError: A path is empty or not finite.
    """
    return warped_distance(resample(one), resample(two))
