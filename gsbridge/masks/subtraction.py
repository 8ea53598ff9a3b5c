"""Which pixels differ from the bare table: the table behind each pixel is known from photos in which nothing covers it.

Colour models cannot tell a dark tip from a dark cloth. But the tip does not have the colour of the very spot of cloth behind
it, and that spot is seen by other photos. Contact shadows lie on the table, are alike in all photos, and so belong to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from gsbridge.cameras import Camera, View, Views
from gsbridge.configuration.masks import MaskSettings
from gsbridge.geometry import Array
from gsbridge.images import read_image_u8
from gsbridge.logs import ProgressLog
from gsbridge.masks import grabcut
from gsbridge.masks.consistency import agreed_hull, outline
from gsbridge.masks.evidence import reached
from gsbridge.masks.flatness import fine_detail
from gsbridge.masks.grabcut import Crop
from gsbridge.masks.layers import MARGIN_PX, disc, free_of, grown, lay_on_table, median_layer
from gsbridge.masks.prompt import Prompt

_OTHERS = 24
"""Photos that the table is taken from; a median needs no more."""
NEEDED = 5
"""Photos that must show a spot of the table before its colour is believed."""
_USUAL = 4.0
"""A pixel differs from the table if it does so by this many times the median difference of bare table."""
_LEAST_DIFFERENCE = 0.045
"""Smallest difference that counts, 0..1 sRGB; below it sensor noise and interpolation decide."""
_MISPLACED_PX = 0.5
"""Error of pose and of linear interpolation that the pattern of the table may show."""
_LOW, _ENOUGH, _WIDER = 0.35, 20, 1.5
"""A foot is below this share of the height; the fewest points of foot and of body; and how much larger its outline must be."""

_BESIDE = 0.1
"""How far beyond its sparse points an object may touch the table, as a share of its size."""
_RIM = 0.15
"""Plain pixels are taken off to this depth, as a share of the object's size."""
_WINDOW = 0.003
"""Smallest share of a mask that a window takes; smaller patches of the table's colour are the object's own marks."""
_WINDOW_MATCH = 0.75
"""Least correlation of a window's pattern with the table behind it: a plain patch may have the table's colour by chance."""
_WINDOW_TEXTURE = 0.005
"""Least standard deviation of that pattern, 0..1."""
_WINDOW_VIEWS = 3
"""Views that must see through before any window is believed."""
_NONE: Array = np.zeros((0, 3))
"""No points."""
_MAJORITY = 0.75
"""Share of the views that must agree on a point before what they add there counts."""


@dataclass(frozen=True)
class Evidence:
    """Evidence from the bare table about the pixels of one photo.

    Args:
        strange: The pixel does not have the table's colour at that spot. [h, w] bool.
        plain: The pixel clearly has it. [h, w] bool. Both are False where too few photos see the spot.
        table: The bare table, RGB 0..1, where it is known; the photo elsewhere. [h, w, 3].
        foot: Its line of sight meets the table where the object may stand, and no photo shows that spot bare. [h, w] bool.
    """

    strange: Array
    plain: Array
    table: Array
    foot: Array


def compare_with_table(
    index: int,
    photos: Sequence[Array | None],
    masks: Sequence[Array],
    cameras: Sequence[Camera],
    poses: Sequence[Array],
    free: Sequence[Array] | None = None,
    ground: Array | None = None,
) -> Evidence:
    """Compare one photo with the table behind it as the other photos show it, laid onto the plane z = 0.

    A spot counts only in photos whose own mask leaves it free; the colour is their median, after a gain per photo and channel
    for cameras that change their exposure.

    Args:
        index: The photo.
        photos: RGB; None where a view does not show the place. [h, w, 3] uint8 each.
        masks: The object as known so far, of the photos' sizes. [h, w] bool each.
        cameras: Pinholes of the photos.
        poses: `cam_from_table`. [4, 4] each.
        free: `free_of` each mask, where many photos are compared; None makes them. [h, w] float32 each.
        ground: Convex outline of the ground on which the object may stand, on the table; None where that does not matter.
            [K, 2].
    """
    photo = photos[index]
    assert photo is not None
    own = photo.astype(np.float32) / 255
    away = cv2.dilate(masks[index].astype(np.uint8), disc(2 * MARGIN_PX)) == 0
    others = compared_photos(index, photos)
    nothing = np.zeros(away.shape, bool)
    if len(others) < NEEDED:
        return Evidence(nothing, nothing, own, nothing)
    free = [free_of(mask) for mask in masks] if free is None else free
    laid = lay_on_table(index, others, photos, free, cameras, poses, away)
    near = grown(masks[index], round(0.25 * np.sqrt(masks[index].sum())))
    table, known = median_layer(laid, near, own, NEEDED)
    if not known.any():
        return Evidence(nothing, nothing, own, nothing)
    smooth, least = excess_over_table(own, table, known & away)
    # Pixels on the outline are of both: they are strange, but not yet the object.
    strange = cv2.erode((known & (smooth > least)).astype(np.uint8), disc(1)) > 0
    plain = cv2.morphologyEx((known & (smooth < 0.5 * least)).astype(np.uint8), cv2.MORPH_OPEN, disc(1)) > 0
    foot = nothing
    if ground is not None:
        unseen = (_over(ground, cameras[index], poses[index]) & near & ~plain) | masks[index]
        # Right beside a mask nothing counts as bare; that margin is no foot.
        foot = (cv2.erode(unseen.astype(np.uint8), disc(MARGIN_PX)) > 0) & ~masks[index]
    return Evidence(strange, plain, table, foot)


def excess_over_table(own: Array, table: Array, bare: Array) -> tuple[Array, float]:
    """Difference between a photo and the table, beyond what small errors of the pose explain, and from where on it counts.

    Args:
        own: The photo, 0..1. [h, w, 3].
        table: The bare table behind it. [h, w, 3].
        bare: Pixels that are taken to show the bare table. [h, w] bool.
    """
    grey = cv2.GaussianBlur((table[..., 0] + table[..., 1] + table[..., 2]) / 3, (0, 0), 0.7)
    slope = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=0.125))
    difference = np.abs(own - table)
    largest = np.maximum(np.maximum(difference[..., 0], difference[..., 1]), difference[..., 2])
    excess = np.maximum(largest - _MISPLACED_PX * slope, 0.0)
    usual = float(np.median(excess[bare])) if bare.any() else 0.0
    return cv2.GaussianBlur(excess, (0, 0), 0.6), max(_USUAL * usual, _LEAST_DIFFERENCE)


def compared_photos(index: int, photos: Sequence[Array | None]) -> list[int]:
    """Photos to compare photo `index` with, by number: at most `_OTHERS`, evenly from all there are. [h, w, 3] each."""
    others = [i for i, other in enumerate(photos) if other is not None and i != index]
    if len(others) > _OTHERS:
        others = [others[i] for i in np.linspace(0, len(others) - 1, _OTHERS).round().astype(int)]
    return others


def ground_of(points: Array) -> Array:
    """Convex outline of the ground on which an object may stand. [N, 3] sparse points of it -> [K, 2], on the table."""
    corners = cv2.convexHull(np.ascontiguousarray(points[:, :2], dtype=np.float32))[:, 0].astype(np.float64)
    reach = _BESIDE * float(np.ptp(points, axis=0).max())
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    wider = (corners[:, None] + reach * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).reshape(-1, 2)
    return np.asarray(cv2.convexHull(wider.astype(np.float32))[:, 0], dtype=np.float64)


def stands_wide(points: Array) -> bool:
    """Whether an object's foot is wider than what stands on it, by its sparse points. [N, 3].

    Only then is the ground that no photo shows surely the object's: under what hangs over, as under a ball, it is hidden, too.
    """
    low = points[:, 2] < _LOW * points[:, 2].max()
    if min(np.count_nonzero(low), np.count_nonzero(~low)) < _ENOUGH:
        return False
    foot, body = (cv2.contourArea(cv2.convexHull(part[:, :2].astype(np.float32))) for part in (points[low], points[~low]))
    return bool(foot > _WIDER * body)


def _over(ground: Array, camera: Camera, pose: Array) -> Array:
    """Pixels whose line of sight meets the table within an outline; none where it reaches behind the camera. -> [h, w] bool."""
    out = np.zeros((camera.height, camera.width), np.uint8)
    pixels = camera.project(np.c_[ground, np.zeros(len(ground))] @ pose[:3, :3].T + pose[:3, 3])
    if np.isfinite(pixels).all():
        cv2.fillConvexPoly(out, cv2.convexHull(np.rint(pixels - 0.5).astype(np.int32)), 1)
    return out > 0


def amend(mask: Array, evidence: Evidence, allowed: Array | None = None) -> Array:
    """Correct a mask by the bare table: add patches that differ from it, and the foot; take off rims that look like it.

    A dark foot on a dark table differs as little from the table as the table itself, but no photo shows the table bare where
    the foot stands.

    Args:
        mask: The object so far. [h, w] bool.
        evidence: Evidence of the same photo.
        allowed: Where the object can be at all, from the other views; None: everywhere. [h, w] bool.

    Returns:
        [h, w] bool; may hold patches apart from the object.
    """
    added = cv2.morphologyEx((evidence.strange & ~mask).astype(np.uint8), cv2.MORPH_OPEN, disc(1)) > 0
    added |= cv2.morphologyEx((evidence.foot | mask).astype(np.uint8), cv2.MORPH_OPEN, disc(2)) > 0
    if allowed is not None:
        added &= allowed
    depth = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    # Inside the object a spot may have the table's colour by chance; only the rim is judged.
    rim = cv2.morphologyEx((evidence.plain & mask).astype(np.uint8), cv2.MORPH_OPEN, disc(1)) > 0
    rim &= depth < _RIM * np.sqrt(max(mask.sum(), 1))
    _, patches = cv2.connectedComponents((rim | ~mask).astype(np.uint8), connectivity=4)
    rim &= np.isin(patches, np.unique(patches[~mask]))
    return cv2.morphologyEx(((mask & ~rim) | added).astype(np.uint8), cv2.MORPH_OPEN, disc(1)) > 0


def windows(mask: Array, photo: Array, evidence: Evidence) -> Array:
    """Parts of a mask through which the table is seen: they have its colour of that very spot, and its pattern.

    Args:
        mask: The object so far. [h, w] bool.
        photo: RGB. [h, w, 3] uint8.
        evidence: Evidence of this photo.

    Returns:
        [h, w] bool.
    """
    found = np.zeros(mask.shape, bool)
    same = (evidence.plain & mask).astype(np.uint8)
    # Where a rim turns away from the light it takes on any table's brightness: such ribbons are no windows.
    core = cv2.morphologyEx(same, cv2.MORPH_OPEN, disc(max(2, round(0.02 * np.sqrt(mask.sum())))))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(core, connectivity=4)
    behind = np.clip(255 * evidence.table, 0, 255).astype(np.uint8)
    for label in range(1, count):
        if stats[label, cv2.CC_STAT_AREA] > _WINDOW * mask.sum():
            patch = labels == label
            # The window's frame stands out in the photo alone; without it a faint pattern is enough.
            a, b = (fine_detail(picture, patch)[patch] for picture in (photo, behind))
            a, b = a - a.mean(), b - b.mean()
            spread = float(a.std() * b.std())
            if min(a.std(), b.std()) > _WINDOW_TEXTURE and float((a * b).mean()) > _WINDOW_MATCH * spread:
                found |= (cv2.dilate(patch.astype(np.uint8), disc(3)) > 0) & (same > 0)
    # Pixels on a window's border are of both; half of them are the window's.
    return (cv2.dilate(found.astype(np.uint8), disc(1)) > 0) & mask & ~evidence.strange


def open_windows(
    views: Views, masks: Sequence[Array], settings: MaskSettings, threads: int, progress: ProgressLog | None = None
) -> list[Array]:
    """Masks without the windows through which several photos see the table.

    What is seen through a window stands far behind the object, so wider parts of the photos are compared than for its outline.

    Args:
        views: Posed, undistorted photos.
        masks: The object, its windows filled. [H, W] float32 each.
        settings: See `MaskSettings`.
        threads: Threads to use.
        progress: Counts each photo once.

    Returns:
        [H, W] float32 each; the same where fewer than three photos see through the object.
    """
    poses = [view.cam_from_table for view in views]
    crops, cameras, photos, parts = _cut_round_masks(views, masks, round(1.5 * settings.crop_px), 1.0, threads)

    free = [free_of(part) for part in parts]

    def look(index: int) -> Array:
        photo = photos[index]
        if photo is None:
            return parts[index]
        return windows(parts[index], photo, compare_with_table(index, photos, parts, cameras, poses, free))

    with ThreadPoolExecutor(threads) as pool:
        looked = pool.map(look, range(len(views)))
        found = list(looked if progress is None else progress.counted(looked))
    if sum(bool(part.any()) for part in found) < _WINDOW_VIEWS:
        return list(masks)
    out = []
    for mask, crop, part in zip(masks, crops, found, strict=True):
        opened = mask.copy()
        if crop is not None and part.any():
            opened[crop.paste(part, mask.shape[::-1]) > 0.5] = 0.0
        out.append(opened)
    return out


def _cut_round_masks(
    views: Views, masks: Sequence[Array], longest: int, margin: float, threads: int
) -> tuple[list[Crop | None], list[Camera], list[Array | None], list[Array]]:
    """The part of each photo round its mask, at most `longest` px long.

    Returns:
        Crops; cameras of the parts; photos [h, w, 3] uint8; masks [h, w] bool. None, None and an empty mask where a mask is.
    """

    def cut(view: View, mask: Array) -> tuple[Crop | None, Camera, Array | None, Array]:
        crop = _round_mask(mask, longest, margin)
        if crop is None:
            return None, view.camera, None, np.zeros((0, 0), bool)
        photo = crop.cut(read_image_u8(views.path(view)))
        return crop, crop.camera(view.camera), photo, crop.cut(mask) > 0.5

    with ThreadPoolExecutor(threads) as pool:
        found = list(pool.map(cut, views, masks))
    crops, cameras, photos, parts = (list(column) for column in zip(*found, strict=True))
    return crops, cameras, photos, parts


def _round_mask(mask: Array, longest: int, margin: float) -> Crop | None:
    """The part of a photo round its mask, with a margin; None where the mask is empty."""
    inside = mask > 0.5
    rows, columns = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
    if len(rows) == 0:
        return None
    corners = np.array([[columns[0], rows[0]], [columns[-1] + 1, rows[-1] + 1]], float)
    return Crop.around(corners, mask.shape[::-1], longest, margin)


def subtract_table(
    views: Views,
    masks: Sequence[Array],
    prompt: Prompt,
    settings: MaskSettings,
    threads: int,
    progress: ProgressLog | None = None,
    lost: Array = _NONE,
) -> list[Array]:
    """Masks corrected by the bare table, where the views agree on the correction.

    Args:
        views: Posed, undistorted photos.
        masks: The object so far. [H, W] float32 each.
        prompt: What the sparse model says.
        settings: See `MaskSettings`.
        threads: Threads to use.
        progress: Counts each photo once in every round.
        lost: Points of the object that earlier masks had lost and that these must hold. [L, 3].

    Returns:
        [H, W] float32 each.
    """
    masks = list(masks)
    for _ in range(settings.subtractions):
        # What one round finds no longer hides the table from the next.
        masks = _subtract_once(views, masks, prompt, settings, threads, progress, lost)
    return masks


def _subtract_once(
    views: Views,
    masks: list[Array],
    prompt: Prompt,
    settings: MaskSettings,
    threads: int,
    progress: ProgressLog | None,
    lost: Array,
) -> list[Array]:
    """Run one round of `subtract_table`."""
    poses = [view.cam_from_table for view in views]
    crops, cameras, photos, parts = _cut_round_masks(views, masks, settings.crop_px, 0.25, threads)

    ground = ground_of(prompt.points) if stands_wide(prompt.points) else None
    free = [free_of(part) for part in parts]

    def compare(index: int) -> Evidence | None:
        return None if crops[index] is None else compare_with_table(index, photos, parts, cameras, poses, free, ground)

    def amended(index: int, allowed: Array | None = None) -> Array:
        view, crop, evidence = views[index], crops[index], found[index]
        if crop is None or evidence is None:
            return masks[index]
        pixels = crop.pixels(view.camera.project(prompt.points @ poses[index][:3, :3].T + poses[index][:3, 3]))
        part = amend(parts[index], evidence, allowed)
        if len(lost):
            part = reached(part, crop.pixels(view.camera.project(lost @ poses[index][:3, :3].T + poses[index][:3, 3])))
        part = grabcut.tidy(part, pixels)
        return crop.paste(part, (view.camera.width, view.camera.height))

    def agreed(index: int) -> Array:
        covered = outline(hull, cameras[index], poses[index])
        width = max(1, round(0.03 * np.sqrt(covered.sum())))
        return amended(index, cv2.dilate(covered.astype(np.uint8), disc(width)) > 0)

    with ThreadPoolExecutor(threads) as pool:
        compared = pool.map(compare, range(len(views)))
        found = list(compared if progress is None else progress.counted(compared))
        # A shadow that moved, or a thing beside the object that did, is strange too, but nowhere in space.
        hull = agreed_hull(views, list(pool.map(amended, range(len(views)))), prompt, settings, _MAJORITY, threads)
        return list(pool.map(agreed, range(len(views))))
