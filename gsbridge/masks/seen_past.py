"""Points beside an object at which no part of it can be, because photos show what lies behind them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from gsbridge.cameras import View
from gsbridge.geometry import Array
from gsbridge.masks.layers import grown
from gsbridge.photogrammetry.sparse import SparsePoints

_BEHIND = 0.02
"""A point lies behind another if it is farther away by more than this share of the object's size, as depths are uncertain."""


def seen_past(
    views: Sequence[View], masks: Sequence[Array], sparse: SparsePoints, chosen: Array, slack: float, size: float
) -> Array:
    """Points at which no part of the object can be, since photos whose masks exclude them show what lies behind them.

    Where an outline crosses the pattern of the table, there is a corner in the photo but none in space. The corner slides from
    photo to photo, and neighbouring photos triangulate it to a place beside the object. Like points of the object, it may have
    a long track, a small residual and rays far apart. But a part of the object hides what lies behind it: the points that other
    photos show at the part's pixels lie on the part or in front of it, while beside the object they lie on the table behind.
    Photos in which the point itself was found do not count, since they may be wrong. A thin part that is found in all photos is
    therefore kept, and so is a point in front of a table without a pattern, where no point behind it was found.

    Args:
        views: Posed photos, in the order of the sparse model's.
        masks: One per view, 0..1. [H, W] each.
        sparse: The sparse model.
        chosen: Numbers of the points. [K].
        slack: Distance in a photo up to which a point beside a mask counts as inside, and two points count as at the same
            place, as a share of the square root of the mask's area.
        size: Longest side of the object, m.

    Returns:
        Whether each chosen point was looked past. [K] bool.
    """
    there, behind = np.zeros((2, len(chosen)))
    for number, (view, mask) in enumerate(zip(views, masks, strict=True)):
        inside = mask > 0.5
        shown = sparse.seen_by(number)
        if not (len(shown) and inside.any()):
            continue
        reach = 1 + slack * np.sqrt(inside.sum())
        pixels, depth = _placed(view, sparse.points[shown])
        wanted, limit = _placed(view, sparse.points[chosen])
        place = np.floor(np.nan_to_num(wanted, nan=-1)).astype(int)[:, ::-1]
        framed = (place >= 0).all(axis=1) & (place < inside.shape).all(axis=1)
        asked = np.flatnonzero(framed & ~np.isin(chosen, shown))
        asked = asked[~grown(inside, round(reach))[place[asked, 0], place[asked, 1]]]
        tree = cKDTree(np.nan_to_num(pixels, nan=-1e6))
        for index, near in zip(asked, tree.query_ball_point(wanted[asked], reach), strict=True):
            farther = int((depth[near] > limit[index] + _BEHIND * size).sum())
            behind[index] += farther
            there[index] += len(near) - farther
    return np.asarray(behind > there)


def _placed(view: View, points: Array) -> tuple[Array, Array]:
    """Pixels of points in a view, NaN behind the camera, and their depths, m. [N, 3] -> [N, 2], [N]."""
    local = points @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3]
    return view.camera.project(local), local[:, 2]
