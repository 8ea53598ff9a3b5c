"""The masks stage: one 8-bit mask of the object per registered photo."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np

from gsbridge.cameras import View, Views
from gsbridge.configuration.masks import MaskSettings
from gsbridge.configuration.scenes import MaskPoint
from gsbridge.errors import StageError
from gsbridge.files import atomic_directory, write_stage
from gsbridge.geometry import Array
from gsbridge.images import read_image_u8, write_image
from gsbridge.logs import ProgressLog
from gsbridge.masks import flatness, grabcut, sam2
from gsbridge.masks.consistency import agreed_hull, disagreements, outline, overlap, shrunk
from gsbridge.masks.evidence import doubts, lost_parts, lost_points, mended, missed_points, reached, surely_placed
from gsbridge.masks.grabcut import BACK, FRONT, UNSURE_BACK, UNSURE_FRONT, Crop
from gsbridge.masks.hints import Hints, hinted, read_hints, rows_among
from gsbridge.masks.prompt import Prompt
from gsbridge.masks.standing_out import find_plain_object
from gsbridge.masks.subtraction import open_windows, subtract_table
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.matting import estimate_alpha
from gsbridge.photogrammetry.sparse import SparsePoints, read_points

logger = logging.getLogger("gsbridge")

_SEEN_RADIUS = 0.006
"""Radius of the disc round a measured point that is labelled as object, as a share of the longest side of the crop."""
_HINT_RADIUS = 0.012
"""Radius of the disc for which a hint holds, as a share of the crop's longest side; in finished masks, as a share of the root
of the mask's area."""


def _pixels(view: View, points: Array) -> Array:
    """Pixels of table points in a view; NaN behind the camera. [N, 3] -> [N, 2]."""
    return view.camera.project(points @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3])


def _stamp_hints(labels: Array, crop: Crop, hints: Hints) -> None:
    """Write a person's hints into GrabCut labels, in place. [h, w] uint8."""
    radius = max(1, round(_HINT_RADIUS * max(crop.size)))
    grabcut.stamp(labels, crop.pixels(hints.drop), radius, BACK)
    grabcut.stamp(labels, crop.pixels(hints.keep), radius, FRONT)


def _first_labels(view: View, index: int, crop: Crop, prompt: Prompt, sparse: SparsePoints) -> Array:
    """GrabCut labels from the sparse points alone. [h, w] uint8."""
    labels = np.full(crop.size[::-1], BACK, np.uint8)
    box = crop.pixels(_pixels(view, prompt.box_corners()))
    object_pixels = crop.pixels(_pixels(view, prompt.points))
    if np.isfinite(box).all():
        cv2.fillConvexPoly(labels, cv2.convexHull(box.astype(np.int32)), int(UNSURE_BACK))
    hull = np.zeros(labels.shape, np.uint8)
    cv2.fillConvexPoly(hull, cv2.convexHull(object_pixels[np.isfinite(object_pixels).all(axis=1)].astype(np.int32)), 1)
    labels[hull > 0] = UNSURE_FRONT
    # Object points lie within the outline in every view, visible there or not; noise may push the outermost ones outside.
    border = 2 * round(0.08 * np.sqrt(hull.sum())) + 1
    inner = cv2.erode(hull, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (border, border))) > 0
    radius = max(2, round(0.012 * max(crop.size)))
    front = labels.copy()
    grabcut.stamp(front, object_pixels, radius, FRONT)
    seen = np.intersect1d(sparse.seen_by(index), prompt.table)
    grabcut.stamp(labels, crop.pixels(_pixels(view, sparse.points[seen])), radius, BACK)
    labels[(front == FRONT) & inner] = FRONT
    if not (labels == FRONT).any():
        grabcut.stamp(labels, object_pixels, 1, FRONT)
    return labels


def _stamp_seen(labels: Array, covered: Array, seen: Array) -> None:
    """Label discs round points of the object that the photo shows as `FRONT`, in place. [h, w] uint8, [h, w] bool."""
    front = labels.copy()
    grabcut.stamp(front, seen, max(1, round(_SEEN_RADIUS * max(labels.shape))), FRONT)
    # Wrong matches lie beside the outline, so only pixels within it are labelled.
    labels[(front == FRONT) & covered] = FRONT


def _band_labels(hull: Array, before: Array, width: float) -> Array:
    """GrabCut labels from the hull's outline: undecided near the outline, within about `width` px, and certain beyond that.

    The inside is certain only where the previous mask agrees: at the ends of a camera path the hull is too large, because all
    other views look from one side.
    """
    mask = hull.astype(np.uint8)
    labels = np.where(hull, UNSURE_FRONT, UNSURE_BACK).astype(np.uint8)
    labels[(cv2.erode(mask, _disc(width)) > 0) & before] = FRONT
    # Where views are missing a hull is too large, never too small, so the undecided band is narrower outside.
    labels[cv2.dilate(mask, _disc(0.6 * width)) == 0] = BACK
    return labels


def _disc(radius: float) -> Array:
    """Round structuring element of at least one pixel's radius."""
    size = 2 * max(1, round(radius)) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))


def _flat_pixels(
    views: Views, crops: list[Crop | None], photos: list[Array | None], prompt: Prompt, threads: int
) -> list[Array]:
    """Pixels of each crop that lie on the table, from parallax. [h, w] bool each (empty where there is no crop)."""
    greys = [None if photo is None else flatness.fine_detail(photo) for photo in photos]
    cameras = [view.camera if crop is None else crop.camera(view.camera) for view, crop in zip(views, crops, strict=True)]
    poses = [view.cam_from_table for view in views]
    others = flatness.choose_others(np.stack([view.centre for view in views]), prompt.points.mean(0))

    def work(index: int) -> Array:
        if greys[index] is None:
            return np.zeros((0, 0), bool)
        return flatness.table_pixels(index, greys, cameras, poses, others[index])

    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, range(len(views))))


def _grabcut_masks(
    views: Views,
    prompt: Prompt,
    sparse: SparsePoints,
    hints: Sequence[Hints],
    settings: MaskSettings,
    seed: int,
    threads: int,
    rough: Mesh | None,
) -> tuple[list[Array], Mesh]:
    """Masks of all views: GrabCut, then a hull, then GrabCut in a band along the hull's outline, repeatedly.

    Returns the masks, [H, W] float32 0..1 each, and the last hull. A rough hull known beforehand replaces the first masks.
    """
    crops = [
        Crop.around(_pixels(view, prompt.box_corners()), (view.camera.width, view.camera.height), settings.crop_px)
        for view in views
    ]
    photos = [
        None if crop is None else crop.cut(read_image_u8(views.path(view))) for view, crop in zip(views, crops, strict=True)
    ]
    flat = _flat_pixels(views, crops, photos, prompt, threads)
    progress = ProgressLog(len(views) * (1 + settings.passes + settings.subtractions + 1), "masks")

    def cut(index: int, hull: Mesh | None, share: float) -> Array:
        view, crop, photo = views[index], crops[index], photos[index]
        if crop is None or photo is None:
            return np.zeros((view.camera.height, view.camera.width), np.float32)
        object_pixels = crop.pixels(_pixels(view, prompt.points))
        if hull is None:
            labels = _first_labels(view, index, crop, prompt, sparse)
        else:
            covered = outline(hull, crop.camera(view.camera), view.cam_from_table)
            before = crop.cut(masks[index]) > 0.5 if masks else covered
            covered = reached(covered, crop.pixels(_pixels(view, sparse.points[lost])))
            labels = _band_labels(covered, before, share * np.sqrt(max(covered.sum(), 1.0)))
            seen = np.intersect1d(sparse.seen_by(index), np.flatnonzero(members))
            _stamp_seen(labels, covered, crop.pixels(_pixels(view, sparse.points[seen])))
        labels[flat[index] & ((labels == UNSURE_BACK) if hull is None else (labels != FRONT))] = BACK
        _stamp_hints(labels, crop, hints[index])
        mask = grabcut.cut_out(photo, labels, settings.iterations, seed + index)
        mask = grabcut.tidy(reached(mask, crop.pixels(_pixels(view, sparse.points[lost]))), object_pixels)
        return crop.paste(mask, (view.camera.width, view.camera.height))

    hull = rough
    members = rows_among(sparse.points, prompt.points) & surely_placed(views, sparse)
    lost = np.zeros(len(members), bool)
    masks: list[Array] = []
    with ThreadPoolExecutor(threads) as pool:
        for number in range(1 + settings.passes):
            share = 0.12 / 1.6 ** max(number - 1, 0)
            jobs = [pool.submit(cut, index, hull, share) for index in range(len(views))]
            masks = [job.result() for job in progress.counted(jobs)]
            lost = lost | lost_points(views, masks, sparse, members)
            # The first masks are wrong in many views, so their vote is lower; later masks must agree better.
            vote = settings.hull_vote if number == 0 else settings.strict_vote
            hull = agreed_hull(views, masks, prompt, settings, vote, threads)
    masks = subtract_table(views, masks, prompt, settings, threads, progress, sparse.points[lost])
    masks = open_windows(views, masks, settings, threads, progress)
    return masks, agreed_hull(views, masks, prompt, settings, settings.strict_vote, threads)


def _smoothed(mask: Array, hull: Array) -> Array:
    """Fill small bites in a mask where the hull says object, and remove small spurs where it says none. [H, W] -> [H, W] bool.

    Bites come from marks on the object in the table's colour, spurs from marks on the table in the object's.
    """
    inside = mask > 0.5
    brush = _disc(max(2.0, 0.04 * np.sqrt(inside.sum())))
    # Pixels beyond the photo's border count as background, or the closing would fill a sliver between object and border.
    closed = (
        cv2.morphologyEx(inside.astype(np.uint8), cv2.MORPH_CLOSE, brush, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    )
    filled = inside | (closed & hull)
    opened = cv2.morphologyEx(filled.astype(np.uint8), cv2.MORPH_OPEN, brush) > 0
    sure = cv2.erode(hull.astype(np.uint8), _disc(1)) > 0
    return opened | (filled & sure)


def _finished(views: Views, masks: list[Array], hull: Mesh, hints: Sequence[Hints], threads: int) -> list[Array]:
    """Smooth the outlines of masks, and give pixels on them the object's share in the pixel. -> list of [H, W] float32."""

    def work(index: int) -> Array:
        view = views[index]
        if not (masks[index] > 0.5).any():
            return masks[index]
        covered = outline(hull, view.camera, view.cam_from_table)
        smooth = _smoothed(masks[index], covered).astype(np.uint8)
        radius = max(1, round(_HINT_RADIUS * np.sqrt(smooth.sum())))
        grabcut.stamp(smooth, hints[index].drop, radius, 0)
        grabcut.stamp(smooth, hints[index].keep, radius, 1)
        return estimate_alpha(read_image_u8(views.path(view)), smooth.astype(np.float32))

    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, range(len(views))))


def segment_object(
    views: Views,
    points_npz: str | Path,
    out_images: str | Path,
    out_json: str | Path,
    settings: MaskSettings | None = None,
    seed: int = 0,
    threads: int = 1,
    points: Sequence[MaskPoint] = (),
) -> None:
    """Cut the object out of every registered photo.

    Args:
        views: Posed, undistorted photos.
        points_npz: Sparse points of the align stage.
        out_images: Folder of the 8-bit masks, one PNG per photo with the photo's stem; made new. 255 on the object, 0
            beside it, the object's share in pixels on its outline.
        out_json: Record of the stage.
        settings: See `MaskSettings`.
        seed: Random seed.
        threads: Threads to use.
        points: Hints by a person about single pixels, see `SceneMasks`.

    Raises:
        InputError: A file or setting cannot be used.
        StageError: No object is found, or its masks come out empty.
    """
    settings = settings or MaskSettings()
    if len(views) < 3:
        raise StageError("masks", f"{len(views)} photos are registered, 3 are needed", "Film again with more overlap")
    sparse = read_points(points_npz)
    prompt, rough = find_plain_object(views, sparse, settings, threads)
    hints = read_hints(points, list(views))
    if points and rough is None:
        prompt = hinted(prompt, sparse, list(views), hints)
    if settings.backend == "sam2":
        masks = sam2.propagate(views, prompt, settings.sam2_weights, threads)
        hull = agreed_hull(views, masks, prompt, settings, settings.hull_vote, threads)
    else:
        masks, hull = _grabcut_masks(views, prompt, sparse, hints, settings, seed, threads, rough)
    members = rows_among(sparse.points, prompt.points)

    def hull_of(chosen: list[int]) -> Mesh:
        parts = [views[i] for i in chosen], [masks[i] for i in chosen]
        return agreed_hull(*parts, prompt, settings, settings.strict_vote, threads)

    missed = missed_points(views, masks, sparse, members, prompt.table)
    whole = mended(views, masks, sparse, members, missed, hull_of)
    if any(one is not other for one, other in zip(whole, masks, strict=True)):
        masks, hull = whole, agreed_hull(views, whole, prompt, settings, settings.strict_vote, threads)
    logger.info("finish the outlines of %d masks", len(masks))
    masks = _finished(views, masks, hull, hints, threads)
    shares = [float((mask > 0.5).mean()) for mask in masks]
    agreement = []
    for view, mask in zip(views, masks, strict=True):
        small = shrunk(mask)
        camera = view.camera.scaled(small.shape[1] / view.camera.width)
        agreement.append(overlap(small, outline(hull, camera, view.cam_from_table)))
    empty = [view.name for view, share in zip(views, shares, strict=True) if share == 0.0]
    if len(empty) > 0.2 * len(views):
        raise StageError(
            "masks",
            f"the mask is empty in {len(empty)} of {len(views)} photos, for example {empty[0]}",
            "Keep the whole object in the picture and use a table of another colour, or use the sam2 backend with weights",
        )
    reasons = [f"the mask of {name} is empty" for name in empty]
    if prompt.nearer:
        reasons.append(
            f"something with {prompt.nearer} points stands nearer to where the cameras look than what was taken, which has "
            "more: film one thing alone, or mark it with `masks: {points: ...}`"
        )
    mean = float(np.mean(agreement))
    reasons += disagreements(agreement, [view.name for view in views], settings.min_consistency)
    missed = missed_points(views, masks, sparse, members, prompt.table)
    reasons += doubts(missed, [view.name for view in views])
    reasons += lost_parts(views, masks, sparse, members)
    with atomic_directory(out_images) as folder:
        for view, mask in zip(views, masks, strict=True):
            write_image(folder / f"{Path(view.name).stem}.png", mask)
    write_stage(
        out_json,
        reasons=reasons,
        seed=seed,
        packages=("opencv-python-headless", "numba"),
        backend=settings.backend,
        object_points=len(prompt.points),
        prompt="points" if rough is None else "what stands out from the table",
        views={
            view.name: {"area": share, "consistency": value, "missed": item.share, "missed_low": item.low, "table": item.table}
            for view, share, value, item in zip(views, shares, agreement, missed, strict=True)
        },
        area={"mean": float(np.mean(shares)), "min": float(np.min(shares)), "max": float(np.max(shares))},
        consistency={"mean": mean, "min": float(np.min(agreement))},
        **({"points": len(points)} if points else {}),
        box={"low": prompt.low, "high": prompt.high},
    )
    logger.info("masks: %d photos, object %.1f %% of the picture, consistency %.3f", len(views), 100 * np.mean(shares), mean)
