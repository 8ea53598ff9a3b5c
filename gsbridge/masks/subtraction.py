"""Find pixels that differ from the bare table, which is known at each pixel from photos in which nothing covers it.

Colour models cannot tell a dark tip from a dark cloth. But the tip does not have the colour of the very spot of cloth behind
it, and other photos show that spot. Contact shadows lie on the table and look alike in all photos, so they count as table.
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
"""Largest number of photos from which the table's colour is taken; a median needs no more."""
NEEDED = 5
"""Photos that must show a spot of the table before its colour is used."""
_USUAL = 4.0
"""A pixel differs from the table if its difference exceeds this many times the median difference on bare table."""
_LEAST_DIFFERENCE = 0.045
"""Smallest difference that counts, 0..1 sRGB; below it sensor noise and interpolation decide."""
_MISPLACED_PX = 0.5
"""Assumed error of pose and interpolation, px; differences that such a shift of the table's pattern explains do not count."""
_LOW, _ENOUGH, _WIDER = 0.35, 20, 1.5
"""The foot is the part below `_LOW` of the height. It is wide if the area of its outline is more than `_WIDER` times that of
the body above; foot and body need `_ENOUGH` points each."""

_BESIDE = 0.1
"""Distance beyond its sparse points at which an object may still touch the table, as a share of its size."""
_RIM = 0.15
"""Pixels of the table's colour are removed from a mask's rim down to this depth, as a share of the root of the mask's area."""
_WINDOW = 0.003
"""Area of the smallest window as a share of the mask; smaller patches of the table's colour are the object's own marks."""
_WINDOW_MATCH = 0.75
"""Least correlation of a window's pattern with the table behind it: a plain patch may have the table's colour by chance."""
_WINDOW_TEXTURE = 0.005
"""Least standard deviation of that pattern, 0..1."""
_WINDOW_VIEWS = 3
"""Views that must see through the object before any window is accepted."""
_NONE: Array = np.zeros((0, 3))
"""No points."""
_MAJORITY = 0.75
"""Share of the views that must agree on a point before their additions to the masks count there."""


@dataclass(frozen=True)
class Evidence:
    """Evidence from the bare table about the pixels of one photo.

    Args:
        strange: The pixel differs from the table's colour at that spot. [h, w] bool.
        plain: The pixel clearly has that colour. [h, w] bool. Both are False where too few photos see the spot.
        table: The bare table, RGB 0..1, where it is known; the photo elsewhere. [h, w, 3].
        foot: The pixel's line of sight meets the table where the object may stand, and no photo shows that spot bare. [h, w]
            bool.
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

    A spot counts only in photos whose own mask leaves it free. The table's colour is the median of these photos, after a gain
    per photo and channel for cameras that change their exposure.

    Args:
        index: The photo.
        photos: RGB; None where a view does not show the place. [h, w, 3] uint8 each.
        masks: The object as known so far, of the photos' sizes. [h, w] bool each.
        cameras: Pinholes of the photos.
        poses: `cam_from_table`. [4, 4] each.
        free: `free_of` each mask, made beforehand if many photos are compared; None makes them here. [h, w] float32 each.
        ground: Convex outline of the ground on which the object may stand, on the table, m; None to find no foot. [K, 2].
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
    # Pixels on the outline mix object and table: they differ from the table without being the object's, so they are eroded.
    strange = cv2.erode((known & (smooth > least)).astype(np.uint8), disc(1)) > 0
    plain = cv2.morphologyEx((known & (smooth < 0.5 * least)).astype(np.uint8), cv2.MORPH_OPEN, disc(1)) > 0
    foot = nothing
    if ground is not None:
        unseen = (_over(ground, cameras[index], poses[index]) & near & ~plain) | masks[index]
        # No pixel right beside a mask counts as bare, but that margin is no foot, so it is eroded.
        foot = (cv2.erode(unseen.astype(np.uint8), disc(MARGIN_PX)) > 0) & ~masks[index]
    return Evidence(strange, plain, table, foot)


def excess_over_table(own: Array, table: Array, bare: Array) -> tuple[Array, float]:
    """Difference of a photo from the table beyond what small pose errors explain, and the threshold from which it counts.

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
    """Numbers of the photos to compare photo `index` with: at most `_OTHERS`, evenly from all there are. [h, w, 3] each."""
    others = [i for i, other in enumerate(photos) if other is not None and i != index]
    if len(others) > _OTHERS:
        others = [others[i] for i in np.linspace(0, len(others) - 1, _OTHERS).round().astype(int)]
    return others


def ground_of(points: Array) -> Array:
    """Convex outline of the ground on which an object may stand, m. [N, 3] sparse points of the object -> [K, 2]."""
    corners = cv2.convexHull(np.ascontiguousarray(points[:, :2], dtype=np.float32))[:, 0].astype(np.float64)
    reach = _BESIDE * float(np.ptp(points, axis=0).max())
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    wider = (corners[:, None] + reach * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).reshape(-1, 2)
    return np.asarray(cv2.convexHull(wider.astype(np.float32))[:, 0], dtype=np.float64)


def stands_wide(points: Array) -> bool:
    """Whether an object's foot is wider than the body above it, by its sparse points. [N, 3].

    Only then does ground that no photo shows surely belong to the object. Under an overhang, as under a ball, ground is hidden
    without belonging to it.
    """
    low = points[:, 2] < _LOW * points[:, 2].max()
    if min(np.count_nonzero(low), np.count_nonzero(~low)) < _ENOUGH:
        return False
    foot, body = (cv2.contourArea(cv2.convexHull(part[:, :2].astype(np.float32))) for part in (points[low], points[~low]))
    return bool(foot > _WIDER * body)


def _over(ground: Array, camera: Camera, pose: Array) -> Array:
    """Pixels whose line of sight meets the table within an outline; none if that reaches behind the camera. -> [h, w] bool."""
    out = np.zeros((camera.height, camera.width), np.uint8)
    pixels = camera.project(np.c_[ground, np.zeros(len(ground))] @ pose[:3, :3].T + pose[:3, 3])
    if np.isfinite(pixels).all():
        cv2.fillConvexPoly(out, cv2.convexHull(np.rint(pixels - 0.5).astype(np.int32)), 1)
    return out > 0


def amend(mask: Array, evidence: Evidence, allowed: Array | None = None) -> Array:
    """Correct a mask by the bare table: add patches that differ from it, and the foot; take off rims that look like it.

    A dark foot on a dark table does not differ from the table, but no photo shows the table bare where the foot stands.

    Args:
        mask: The object so far. [h, w] bool.
        evidence: Evidence of the same photo.
        allowed: Where the object can be at all, according to the other views; None for everywhere. [h, w] bool.

    Returns:
        [h, w] bool; may hold patches apart from the object.
    """
    added = cv2.morphologyEx((evidence.strange & ~mask).astype(np.uint8), cv2.MORPH_OPEN, disc(1)) > 0
    added |= cv2.morphologyEx((evidence.foot | mask).astype(np.uint8), cv2.MORPH_OPEN, disc(2)) > 0
    if allowed is not None:
        added &= allowed
    depth = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    # Inside the object a spot may have the table's colour by chance, so only the rim is corrected.
    rim = cv2.morphologyEx((evidence.plain & mask).astype(np.uint8), cv2.MORPH_OPEN, disc(1)) > 0
    rim &= depth < _RIM * np.sqrt(max(mask.sum(), 1))
    _, patches = cv2.connectedComponents((rim | ~mask).astype(np.uint8), connectivity=4)
    rim &= np.isin(patches, np.unique(patches[~mask]))
    return cv2.morphologyEx(((mask & ~rim) | added).astype(np.uint8), cv2.MORPH_OPEN, disc(1)) > 0


def windows(mask: Array, photo: Array, evidence: Evidence) -> Array:
    """Find parts of a mask through which the table is seen: they have its colour at that very spot, and its pattern.

    Args:
        mask: The object so far. [h, w] bool.
        photo: RGB. [h, w, 3] uint8.
        evidence: Evidence of this photo.

    Returns:
        [h, w] bool.
    """
    found = np.zeros(mask.shape, bool)
    same = (evidence.plain & mask).astype(np.uint8)
    # A rim that turns away from the light takes on the brightness of any table somewhere; such thin ribbons are no windows.
    core = cv2.morphologyEx(same, cv2.MORPH_OPEN, disc(max(2, round(0.02 * np.sqrt(mask.sum())))))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(core, connectivity=4)
    behind = np.clip(255 * evidence.table, 0, 255).astype(np.uint8)
    for label in range(1, count):
        if stats[label, cv2.CC_STAT_AREA] > _WINDOW * mask.sum():
            patch = labels == label
            # The window's frame is in the photo only, so detail is taken within the patch; then a faint pattern is enough.
            a, b = (fine_detail(picture, patch)[patch] for picture in (photo, behind))
            a, b = a - a.mean(), b - b.mean()
            spread = float(a.std() * b.std())
            if min(a.std(), b.std()) > _WINDOW_TEXTURE and float((a * b).mean()) > _WINDOW_MATCH * spread:
                found |= (cv2.dilate(patch.astype(np.uint8), disc(3)) > 0) & (same > 0)
    # Pixels on a window's border mix object and table; half of them belong to the window.
    return (cv2.dilate(found.astype(np.uint8), disc(1)) > 0) & mask & ~evidence.strange


def open_windows(
    views: Views, masks: Sequence[Array], settings: MaskSettings, threads: int, progress: ProgressLog | None = None
) -> list[Array]:
    """Remove from masks the windows through which several photos see the table.

    The table seen through a window is far behind the object, so larger parts of the photos are compared than for its outline.

    Args:
        views: Posed, undistorted photos.
        masks: The object, its windows filled. [H, W] float32 each.
        settings: See `MaskSettings`.
        threads: Threads to use.
        progress: Counts each photo once.

    Returns:
        [H, W] float32 each; unchanged if fewer than three photos see through the object.
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
        Crops; cameras of the parts; photos [h, w, 3] uint8; masks [h, w] bool. For an empty mask: no crop, the whole photo's
        camera, no photo, and an empty mask.
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
    """Correct masks by the bare table, where the views agree on the correction.

    Args:
        views: Posed, undistorted photos.
        masks: The object so far. [H, W] float32 each.
        prompt: The object as the sparse model shows it.
        settings: See `MaskSettings`.
        threads: Threads to use.
        progress: Counts each photo once in every round.
        lost: Points of the object that earlier masks had lost and that these must hold. [L, 3].

    Returns:
        [H, W] float32 each.
    """
    masks = list(masks)
    for _ in range(settings.subtractions):
        # Pixels that one round adds to the object no longer count as table in the next.
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
        # A shadow or a thing beside the object that moved differs from the table, too, but the views agree on no place for it.
        hull = agreed_hull(views, list(pool.map(amended, range(len(views)))), prompt, settings, _MAJORITY, threads)
        return list(pool.map(agreed, range(len(views))))
