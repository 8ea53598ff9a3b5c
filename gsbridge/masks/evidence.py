"""Check and repair masks by sparse points of the object, which were measured without any mask.

Masks with the same error agree with each other and with their common hull. But if the reconstruction found a point of the
object in a photo, the photo shows the object there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from gsbridge.cameras import View
from gsbridge.geometry import Array
from gsbridge.masks.layers import disc, grown
from gsbridge.masks.prompt import focus_point
from gsbridge.masks.seen_past import seen_past
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.carving import mesh_depth
from gsbridge.photogrammetry.sparse import SparsePoints

_NEAR = 0.015
"""A point nearer than this to a mask is on its outline, as a share of the root of the mask's area."""
_FEWEST = 12
"""Least number of points of the object, or of its lowest part, that a photo must show before its mask is judged by them."""
_CHANCE = 2
"""Up to this many points outside a mask may be wrong matches; only more than that count."""
_LOW = 0.25
"""Height of the object's lowest part, beside which its shadow lies, as a share of the object's height."""
_LOOSE = 0.015
"""How far a hull is assumed to reach beyond the object, as a share of its outline's size."""
_FEWEST_SOUND = 6
"""Least number of masks that are not bitten from which a hull is made."""
BITTEN = 0.1
"""A mask lacks a part of the object (it is *bitten*) if it leaves out more than this share of its photo's object points."""
SPILT = 0.1
"""A mask holds a part of the table if this many of the table's points, or more, lie in it per point of the object."""
MANY = 0.1
"""If more than this share of the masks is bitten, the object's shape is in doubt, too."""
_LOST = 0.3
"""A point is *lost* if more than this share of the masks whose photos show it leave it out."""
_HIDDEN_LOST = 0.06
"""A point is also lost if more than this share of all masks leave it out, counting photos that do not show it: a hull of all
masks would lose the point."""
_LOCAL = 0.25
"""Such a point counts only if this share of the object's points near it is lost in the same way; wrong matches lie among points
that are not lost."""
_SPREAD_DEG = 6.0
"""A point's position is certain if the photos that show it look from directions this far from their mean."""
_WIDEST_GAP_DEG = 160.0
"""No position is certain if the cameras leave a wider gap than this around the place they look at: from one side, a neighbour
looks like a part of the object."""
_REACH = 0.08
"""Gaps narrower than about this between lost points, or between them and the mask, belong to the object, too; a share of the
root of the mask's area."""
_PART, _PART_POINTS = 0.1, 5
"""A part of the object is missing if five lost points lie within a tenth of its size; at most two wrong matches do."""
_COMPANY = 3
"""Lost points beside a mask count only if this many lie within three times `_REACH`; a single one is a wrong match."""


@dataclass(frozen=True)
class Missed:
    """Points that a photo shows on the wrong side of its mask's outline.

    Args:
        share: Share of the object's points that lie outside the mask; 0 if the photo shows too few to tell.
        low: The same share among the points on the object's lowest part; 0 if those are too few.
        table: Number of the table's points well inside the mask, divided by the number of the object's points in the photo
            (taken as `_FEWEST` at least); 0 if fewer than `_FEWEST` of the table's points lie there.
    """

    share: float
    low: float
    table: float

    @property
    def bitten(self) -> bool:
        """Whether more points of the object lie outside the mask than wrong matches explain."""
        return max(self.share, self.low) > BITTEN


def reached(mask: Array, pixels: Array) -> Array:
    """Extend a mask to the lost points beside it, because a hull lacks what some of the masks leave out.

    A point of the object lies within the object's outline in every photo, whether it is visible or hidden there.

    Args:
        mask: Pixels of the object as known so far. [h, w] bool.
        pixels: Positions of points of the object that masks have lost, px; those with NaN are left out. [K, 2].

    Returns:
        [h, w] bool; unchanged if no group of points lies beside the mask, or if the mask is empty, which means it failed.
    """
    if not mask.any():
        return mask
    place = np.floor(pixels[np.isfinite(pixels).all(axis=1)]).astype(int)[:, ::-1]
    place = place[((place >= 0) & (place < mask.shape)).all(axis=1)]
    lost = place[~grown(mask, 1)[place[:, 0], place[:, 1]]]
    radius = max(2, round(_REACH * np.sqrt(mask.sum())))
    if len(lost) < _COMPANY:
        return mask
    firm = lost[cKDTree(lost).query_ball_point(lost, 3 * radius, return_length=True) >= _COMPANY]
    discs = np.zeros(mask.shape, bool)
    discs[firm[:, 0], firm[:, 1]] = True
    whole = mask | grown(discs, radius)
    # Discs reach past the outermost points, and so past the object, so the erosion takes their rim off again. Pixels beyond the
    # photo's border count as background; as object they would fill the sliver between an object and the border.
    inner = cv2.erode(whole.astype(np.uint8), disc(radius), borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    return mask | inner | discs


def _seen(view: View, number: int, sparse: SparsePoints, members: Array) -> tuple[Array, Array]:
    """Numbers of the object's points that a photo shows, and their rows and columns in it. -> [K], [K, 2]."""
    seen = sparse.seen_by(number)
    return _within(view, sparse, seen[members[seen]])


def _within(view: View, sparse: SparsePoints, seen: Array) -> tuple[Array, Array]:
    """Those of the points `seen` that lie within a photo's frame, and their rows and columns in it. [N] -> [K], [K, 2]."""
    pixels = view.camera.project(sparse.points[seen] @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3])
    place = np.floor(np.nan_to_num(pixels, nan=-1)).astype(int)[:, ::-1]
    valid = (place >= 0).all(axis=1) & (place < (view.camera.height, view.camera.width)).all(axis=1)
    return seen[valid], place[valid]


def surely_placed(views: Sequence[View], sparse: SparsePoints) -> Array:
    """Find points whose position is certain; an uncertain one may be a point of the table, lifted by its error.

    The cameras must stand on all sides, and the photos that show a point must look from directions far enough apart.

    Args:
        views: Posed photos, in the order of the sparse model's.
        sparse: The sparse model.

    Returns:
        [N] bool.
    """
    of, centres = sparse.point_index, np.stack([view.centre for view in views])
    # Angles are taken round the place that the cameras look at, because most points may lie on a wall or a shelf behind it.
    around = centres - focus_point(views)
    angles = np.sort(np.degrees(np.arctan2(around[:, 1], around[:, 0])))
    if np.diff(np.append(angles, angles[0] + 360.0)).max() > _WIDEST_GAP_DEG:
        return np.zeros(len(sparse.points), bool)
    rays = centres[sparse.view_index] - sparse.points[of]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    mean = np.zeros(sparse.points.shape)
    np.add.at(mean, of, rays)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
    least = np.ones(len(mean))
    np.minimum.at(least, of, (rays * mean[of]).sum(1))
    return np.asarray(least < np.cos(np.radians(_SPREAD_DEG)))


def lost_points(
    views: Sequence[View], masks: Sequence[Array], sparse: SparsePoints, members: Array, slack: float = 0.0
) -> Array:
    """Find points of the object that masks have lost, for instance on a foot that has the colour of its shadow.

    Photos in which a point was not found count, too: seen from above, a bowl's side is too oblique to match, but it is there.

    Args:
        views: Posed photos, in the order of the sparse model's.
        masks: One per view, 0..1. [H, W] each.
        sparse: The sparse model.
        members: Points of the object. [N] bool.
        slack: Distance from a mask up to which a point is still on its outline, as a share of the root of the mask's area.

    Returns:
        [N] bool.
    """
    shown, outside, framed, beyond = np.zeros((4, len(members)))
    every = np.flatnonzero(members)
    for number, (view, mask) in enumerate(zip(views, masks, strict=True)):
        inside = mask > 0.5
        if inside.any():
            seen, place = _seen(view, number, sparse, members)
            shown[seen] += 1
            outside[seen] += ~grown(inside, 1 + round(slack * np.sqrt(inside.sum())))[place[:, 0], place[:, 1]]
            there, place = _within(view, sparse, every)
            framed[there] += 1
            beyond[there] += ~grown(inside, 1 + round(_NEAR * np.sqrt(inside.sum())))[place[:, 0], place[:, 1]]
    lost = np.asarray((shown > 0) & (outside > _LOST * shown))
    hidden = every[(beyond > _HIDDEN_LOST * framed)[every]]
    if len(hidden) >= _COMPANY:
        reach = _PART * float(np.ptp(sparse.points[every], axis=0).max())
        near, of = (
            cKDTree(sparse.points[group]).query_ball_point(sparse.points[hidden], reach, return_length=True)
            for group in (hidden, every)
        )
        lost[hidden[(near >= _COMPANY) & (near >= _LOCAL * of)]] = True
    return lost


def lost_parts(views: Sequence[View], masks: Sequence[Array], sparse: SparsePoints, members: Array) -> list[str]:
    """Report a small part that masks may lack: too few lost points to count in any photo, but all of them in one place.

    Args:
        views: Posed photos, in the order of the sparse model's.
        masks: One per view, 0..1. [H, W] each.
        sparse: The sparse model.
        members: Points of the object. [N] bool.
    """
    found = np.flatnonzero(lost_points(views, masks, sparse, members & surely_placed(views, sparse), _NEAR))
    if len(found) == 0:
        return []
    size = float(np.ptp(sparse.points[members], axis=0).max())
    # Round a foot on a patterned table, points are measured where outlines cross the pattern. Sound masks leave them out.
    lost = sparse.points[found[~seen_past(views, masks, sparse, found, _NEAR, size)]]
    if len(lost) == 0:
        return []
    reach = _PART * size
    near: Array = np.asarray(cKDTree(lost).query_ball_point(lost, reach, return_length=True))
    most = int(np.argmax(near))
    if near[most] < _PART_POINTS:
        return []
    share = lost[most, 2] / float(np.percentile(sparse.points[members, 2], 99.5))
    return [
        f"the masks leave out {near[most]} points that were measured in one place of the object, at {100 * share:.0f} % of its "
        "height: a part is missing there; mark it with `masks: {points: ...}`"
    ]


def missed_points(
    views: Sequence[View], masks: Sequence[Array], sparse: SparsePoints, members: Array, table: Array
) -> list[Missed]:
    """Count the points that each photo shows on the wrong side of its mask's outline.

    Args:
        views: Posed photos, in the order of the sparse model's.
        masks: One per view, 0..1. [H, W] each.
        sparse: The sparse model.
        members: Points of the object. [N] bool.
        table: Numbers of points on the table. [K].
    """
    flat = np.zeros(len(members), bool)
    flat[table] = True
    height = sparse.points[:, 2]
    low = height < _LOW * np.percentile(height[members], 99) if members.any() else members
    out = []
    for number, (view, mask) in enumerate(zip(views, masks, strict=True)):
        seen, place = _seen(view, number, sparse, members)
        inside = mask > 0.5
        outside = ~grown(inside, 1 + round(_NEAR * np.sqrt(inside.sum())))[place[:, 0], place[:, 1]]
        parts = (outside, outside[low[seen]])
        shares = [float(part.mean()) if len(part) >= _FEWEST and part.sum() > _CHANCE else 0.0 for part in parts]
        _, under = _seen(view, number, sparse, flat & ~members)
        inner = cv2.erode(inside.astype(np.uint8), disc(1 + round(_NEAR * np.sqrt(inside.sum())))) > 0
        spilt = int(inner[under[:, 0], under[:, 1]].sum())
        # Hardly a point is seen on a plain object, but the table's points count there, too.
        out.append(Missed(shares[0], shares[1], spilt / max(len(seen), _FEWEST) if spilt >= _FEWEST else 0.0))
    return out


def mended(
    views: Sequence[View],
    masks: Sequence[Array],
    sparse: SparsePoints,
    members: Array,
    missed: Sequence[Missed],
    hull_of: Callable[[list[int]], Mesh],
) -> list[Array]:
    """Fill masks that lack a part of the object from the hull of those that lack none.

    Args:
        views: Posed photos, in the order of the sparse model's.
        masks: One per view, 0..1. [H, W] each.
        sparse: The sparse model.
        members: Points of the object. [N] bool.
        missed: What `missed_points` gave for each mask.
        hull_of: Visual hull of some of the masks, by their numbers.

    Returns:
        [H, W] float32 each; unchanged if no mask is bitten, or if too many are for the others to tell the shape.
    """
    # An empty mask is a failed one; it is reported as such and not filled from the others.
    some = [number for number, mask in enumerate(masks) if (mask > 0.5).any()]
    bitten = [number for number in some if missed[number].bitten]
    sound = [number for number in some if not missed[number].bitten]
    if not bitten or len(sound) < max(_FEWEST_SOUND, len(bitten)):
        return list(masks)
    hull = hull_of(sound)
    out = list(masks)
    for number in bitten:
        view, mask = views[number], masks[number] > 0.5
        covered = np.isfinite(mesh_depth(hull.vertices, hull.faces, view.camera, view.cam_from_table)).astype(np.uint8)
        inner = cv2.erode(covered, disc(1 + round(_LOOSE * np.sqrt(covered.sum())))) > 0
        # Only patches that contain points of the object are filled; a patch without any may be an opening of the object.
        _, patches = cv2.connectedComponents((inner & ~mask).astype(np.uint8), connectivity=4)
        _, place = _seen(view, number, sparse, members)
        held = np.unique(patches[place[:, 0], place[:, 1]])
        out[number] = (mask | np.isin(patches, held[held > 0])).astype(np.float32)
    return out


def doubts(missed: Sequence[Missed], names: Sequence[str]) -> list[str]:
    """Report masks that may lack a part of the object, or hold a part of the table.

    Args:
        missed: What `missed_points` gave for each photo.
        names: Names of the photos.
    """
    reasons = []
    bitten = [number for number, item in enumerate(missed) if item.bitten]
    if len(bitten) > MANY * len(missed):
        worst = max(bitten, key=lambda number: max(missed[number].share, missed[number].low))
        share = max(missed[worst].share, missed[worst].low)
        where = "its foot" if missed[worst].low > missed[worst].share else "the object"
        reasons.append(
            f"{len(bitten)} of {len(missed)} masks leave out points that were measured on the object, most in {names[worst]}: "
            f"{100 * share:.0f} % of those on {where}"
        )
    spilt = [number for number, item in enumerate(missed) if item.table > SPILT]
    if len(spilt) > MANY * len(missed):
        worst = max(spilt, key=lambda number: missed[number].table)
        reasons.append(
            f"{len(spilt)} of {len(missed)} masks hold points that were measured on the table, most in {names[worst]}"
        )
    return reasons
