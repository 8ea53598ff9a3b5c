"""What speaks against masks, and what mends them: points that were measured on the object without any mask.

Masks that err alike agree with each other, and so does their common hull. But a photo in which the reconstruction found a point
of the object shows the object there.
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
"""A point this near to a mask is on its outline: share of the root of the mask's area."""
_FEWEST = 12
"""Points of the object, or of its lowest part, that a photo must show before they say anything about its mask."""
_CHANCE = 2
"""Points outside a mask that may be wrong matches; only more of them count."""
_LOW = 0.25
"""The lowest part of an object, where its shadow lies, as a share of its height."""
_LOOSE = 0.015
"""How far a hull is taken to reach beyond the object, as a share of its outline's size."""
_FEWEST_SOUND = 6
"""Masks without bites that a hull needs."""
BITTEN = 0.1
"""A mask lacks a part of the object (it is *bitten*) if it leaves out this share of the object's points in its photo."""
SPILT = 0.1
"""A mask holds a part of the table if this many of the table's points, or more, lie in it per point of the object."""
MANY = 0.1
"""If more than this share of the masks is bitten, the object's shape is in doubt, too."""
_LOST = 0.3
"""Masks have *lost* a point if more than this share of those whose photos show it leave it out."""
_HIDDEN_LOST = 0.06
"""Share that counts as lost among all masks, those whose photos do not show the point included: their hull would lose it."""
_LOCAL = 0.25
"""Such a point counts only if this share of the points near it is lost, too: wrong matches lie among points that are not."""
_SPREAD_DEG = 6.0
"""A point's position is certain if the photos that show it look from directions this far from their mean."""
_WIDEST_GAP_DEG = 160.0
"""A position is also uncertain if photos leave a wider gap around it: from one side, a neighbour looks like a part."""
_REACH = 0.08
"""Narrower gaps between measured points, or between them and the mask, belong to the object, too; a share of the root of the
mask's area."""
_PART, _PART_POINTS = 0.1, 5
"""A part of the object is missing where five lost points lie within a tenth of its size; of wrong matches at most two do."""
_COMPANY = 3
"""Measured points beside a mask count if this many lie within three times `_REACH`; a single one is a wrong match."""


@dataclass(frozen=True)
class Missed:
    """Points that a photo shows on the wrong side of its mask's outline.

    Args:
        share: Share of the object's points that lie outside the mask; 0 where the photo shows too few to tell.
        low: The same share among the points on the object's lowest part; 0 where those are too few.
        table: Points of the table well inside the mask, per point of the object, of which `_FEWEST` count at least; 0 where too
            few lie there to tell.
    """

    share: float
    low: float
    table: float

    @property
    def bitten(self) -> bool:
        """Whether more points of the object lie outside the mask than wrong matches explain."""
        return max(self.share, self.low) > BITTEN


def reached(mask: Array, pixels: Array) -> Array:
    """Extend a mask or outline to the measured points beside it: a hull loses what some of the masks leave out.

    A point of the object lies within the object's outline in every photo, seen there or hidden.

    Args:
        mask: Pixels of the object as known so far. [h, w] bool.
        pixels: Where points of the object lie that masks have lost, px; those with NaN are left out. [K, 2].

    Returns:
        [h, w] bool; unchanged where no group of points lies beside it, and where it is empty, which is a failed mask.
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
    # Discs reach past the outermost points, and so past the object: their rim is taken off again. Beyond the photo's border
    # nothing is known: taken for the object, it would fill the sliver between an object and the border.
    inner = cv2.erode(whole.astype(np.uint8), disc(radius), borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    return mask | inner | discs


def _seen(view: View, number: int, sparse: SparsePoints, members: Array) -> tuple[Array, Array]:
    """Points of the object that a photo shows, and their rows and columns in it. -> [K], [K, 2]."""
    seen = sparse.seen_by(number)
    return _within(view, sparse, seen[members[seen]])


def _within(view: View, sparse: SparsePoints, seen: Array) -> tuple[Array, Array]:
    """Points among some that lie within a photo's frame, and their rows and columns in it. [N] -> [K], [K, 2]."""
    pixels = view.camera.project(sparse.points[seen] @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3])
    place = np.floor(np.nan_to_num(pixels, nan=-1)).astype(int)[:, ::-1]
    valid = (place >= 0).all(axis=1) & (place < (view.camera.height, view.camera.width)).all(axis=1)
    return seen[valid], place[valid]


def surely_placed(views: Sequence[View], sparse: SparsePoints) -> Array:
    """Points seen from directions far enough apart, in photos from all sides: others may be table, lifted by their error.

    Args:
        views: Posed photos, in the order of the sparse model's.
        sparse: The sparse model.

    Returns:
        [N] bool.
    """
    of, centres = sparse.point_index, np.stack([view.centre for view in views])
    # Round what the cameras look at: most points may lie on a wall or a shelf behind.
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
    """Points of the object that masks have lost, for instance a foot that has the colour of its shadow.

    Photos that do not show a point count, too: looked at from above, a bowl's side is too oblique to match, but it is there.

    Args:
        views: Posed photos, in the order of the sparse model's.
        masks: One per view, 0..1. [H, W] each.
        sparse: The sparse model.
        members: Points of the object. [N] bool.
        slack: How far beside a mask a point is still on its outline, as a share of the root of the mask's area.

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
    """Why masks may lack a small part that stands off: too few points to count in any photo, but all of them in one place.

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
    # Round a foot on a patterned table many outlines' corners are measured: sound masks leave them out, and so should they.
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
    """Points that each photo shows on the wrong side of its mask's outline.

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
        # Of a plain thing hardly a point is seen; the table's own points tell all the same.
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
        [H, W] float32 each; the same where no mask is bitten, or so many are that the others do not tell the shape.
    """
    # An empty mask is a failed one: it is counted as such, not drawn from the others.
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
        # Only what holds such points: what other photos see through is no bite.
        _, patches = cv2.connectedComponents((inner & ~mask).astype(np.uint8), connectivity=4)
        _, place = _seen(view, number, sparse, members)
        held = np.unique(patches[place[:, 0], place[:, 1]])
        out[number] = (mask | np.isin(patches, held[held > 0])).astype(np.float32)
    return out


def doubts(missed: Sequence[Missed], names: Sequence[str]) -> list[str]:
    """Why masks may lack a part of the object, or hold a part of the table.

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
