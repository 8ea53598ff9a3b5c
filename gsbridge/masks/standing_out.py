"""A first shape for objects so plain that hardly a point is measured on them, from the pixels that hide the table.

No spot of a white box can be matched between photos, but the box hides the table's pattern in each of them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np

from gsbridge.cameras import Camera, View, Views
from gsbridge.configuration.masks import MaskSettings
from gsbridge.errors import StageError
from gsbridge.geometry import Array
from gsbridge.images import read_image_u8
from gsbridge.masks.consistency import hull_of_masks, outline
from gsbridge.masks.grabcut import Crop
from gsbridge.masks.layers import disc, free_of, grown, lay_on_table, median_layer
from gsbridge.masks.prompt import Prompt, find_object, focus_point, working_distance
from gsbridge.masks.subtraction import NEEDED, compare_with_table, compared_photos, excess_over_table
from gsbridge.meshes import Mesh
from gsbridge.photogrammetry.sparse import SparsePoints

logger = logging.getLogger("gsbridge")

FEW_POINTS = 60
"""Fewer measured points than this tell where an object is, but not how large it is."""
_REACH = 0.4
"""Reach of the search to each side of the place the cameras look at, and upwards from the table, as a share of the working
distance."""
_CROP = 400
"""Longest side of the parts of the photos that are compared, px."""
_MARGIN = 0.1
"""Assumed error of the first hull, as a share of its outline's size."""
_SAMPLES = 2000
"""Points of the rough hull that stand in for measured ones."""
_VOTE = 0.5
"""Share of the photos in which a place must stand out. It is low because a plain object's front does not stand out in photos
taken from that side (see `hidden_table`)."""


def hidden_table(index: int, photos: Sequence[Array | None], cameras: Sequence[Camera], poses: Sequence[Array]) -> Array:
    """Pixels in which one photo differs from the table as most others show it, before anything is known of the object.

    Every spot beside an object is seen bare from most sides, so the median over all photos is the table. On the object's
    footprint the median is the object itself, so a plain object does not stand out where it covers its own footprint.

    Args:
        index: The photo.
        photos: RGB; None where a view does not show the place. [h, w, 3] uint8 each.
        cameras: Pinholes of the photos.
        poses: `cam_from_table`. [4, 4] each.

    Returns:
        [h, w] bool; False where too few photos see the table.
    """
    photo = photos[index]
    others = compared_photos(index, photos)
    if photo is None or len(others) < NEEDED:
        return np.zeros((1, 1) if photo is None else photo.shape[:2], bool)
    everywhere = np.ones(photo.shape[:2], bool)
    free = [np.ones((1, 1) if other is None else other.shape[:2], np.float32) for other in photos]
    own = photo.astype(np.float32) / 255
    table, known = median_layer(lay_on_table(index, others, photos, free, cameras, poses, everywhere), everywhere, own, NEEDED)
    smooth, least = excess_over_table(own, table, known)
    strange = (known & (smooth > least)).astype(np.uint8)
    return cv2.morphologyEx(strange, cv2.MORPH_OPEN, disc(1)) > 0


def hull_standing_out(views: Views, focus: Prompt, settings: MaskSettings, threads: int) -> Mesh | None:
    """Rough hull of the thing that hides the table at the place the cameras look at.

    Args:
        views: Posed, undistorted photos.
        focus: Where the object is assumed to be.
        settings: See `MaskSettings`.
        threads: Threads to use.

    Returns:
        The hull, table frame; None where nothing stands out, as on a table without a pattern and of the object's colour.
    """
    corners = focus.box_corners()

    def cut(view: View) -> tuple[Crop | None, Camera, Array | None]:
        pixels = view.camera.project(corners @ view.cam_from_table[:3, :3].T + view.cam_from_table[:3, 3])
        crop = Crop.around(pixels, (view.camera.width, view.camera.height), _CROP, 0.1)
        if crop is None:
            return None, view.camera, None
        return crop, crop.camera(view.camera), crop.cut(read_image_u8(views.path(view)))

    with ThreadPoolExecutor(threads) as pool:
        crops, cameras, photos = (list(column) for column in zip(*pool.map(cut, views), strict=True))
    poses = [view.cam_from_table for view in views]
    shown = [index for index, crop in enumerate(crops) if crop is not None]
    cropped = [replace(views[index], camera=cameras[index]) for index in shown]

    def hull_of(look: Callable[[int], Array], vote: float) -> Mesh | None:
        with ThreadPoolExecutor(threads) as pool:
            parts = list(pool.map(look, shown))
        return hull_of_masks(cropped, parts, focus, vote=vote, voxels=settings.hull_voxels, threads=threads)

    rough = hull_of(lambda index: hidden_table(index, photos, cameras, poses), _VOTE)
    if rough is None:
        return None
    # Now that the object's place is known, the table's colour at a spot comes only from photos that show the spot bare.
    guesses = [_grown_outline(rough, camera, pose) for camera, pose in zip(cameras, poses, strict=True)]
    free = [free_of(guess) for guess in guesses]

    def not_bare(index: int) -> Array:
        plain = compare_with_table(index, photos, guesses, cameras, poses, free).plain
        return cv2.morphologyEx((guesses[index] & ~plain).astype(np.uint8), cv2.MORPH_OPEN, disc(2)) > 0

    return hull_of(not_bare, settings.hull_vote) or rough


def _grown_outline(hull: Mesh, camera: Camera, pose: Array) -> Array:
    """Pixels that a rough hull covers, and a margin for its errors. [h, w] bool."""
    covered = outline(hull, camera, pose)
    return grown(covered, max(1, round(_MARGIN * float(np.sqrt(covered.sum())))))


def find_plain_object(views: Views, sparse: SparsePoints, settings: MaskSettings, threads: int) -> tuple[Prompt, Mesh | None]:
    """Find the object by its measured points or, if they are few, by the pixels that differ from the table there.

    Args:
        views: Posed, undistorted photos.
        sparse: Sparse model in the table frame.
        settings: See `MaskSettings`.
        threads: Threads to use.

    Returns:
        The prompt, and the rough hull if the prompt comes from one.

    Raises:
        StageError: Too few points lie on an object, and nothing stands out from the table.
    """
    few: StageError | None = None
    found: Prompt | None = None
    try:
        found = find_object(views, sparse, settings.height_share, settings.min_points)
    except StageError as error:
        few = error
    if found is not None and len(found.points) >= FEW_POINTS:
        return found, None
    around = _surroundings(views, found)
    hull = hull_standing_out(views, around, settings, threads)
    if hull is None:
        if found is None:
            assert few is not None  # there is a prompt, or a reason why not
            raise few
        return found, None
    logger.info("masks: hardly a point is measured on the object; its first shape is what stands out from the table")
    low, high = hull.vertices.min(0), hull.vertices.max(0)
    margin = 0.3 * float((high - low).max()) + 0.02 * around.distance
    height = sparse.points[:, 2]
    near = ((sparse.points[:, :2] > low[:2] - margin) & (sparse.points[:, :2] < high[:2] + margin)).all(axis=1)
    flat = 0.5 * settings.height_share * around.distance
    table = np.flatnonzero((np.abs(height) < flat) & ~(near & (height > 0.5 * flat)))
    box = np.array([*(low - margin)[:2], 0.0]), high + margin
    return Prompt(hull.vertices[:: max(1, len(hull.vertices) // _SAMPLES)], table, *box, around.distance), hull


def _surroundings(views: Views, found: Prompt | None) -> Prompt:
    """Prompt whose box is to be searched for an object, some points of which may be known from `found`."""
    focus = focus_point(views)
    distance = working_distance(views, focus)
    middle = focus if found is None else np.median(found.points, axis=0)
    reach = _REACH * distance
    low, high = np.array([*(middle[:2] - reach), 0.0]), np.array([*(middle[:2] + reach), reach])
    # Without points, a column at the place the cameras look at stands in for the object.
    column = np.c_[np.tile(middle[:2], (20, 1)), np.linspace(0, reach, 20)]
    return Prompt(column if found is None else found.points, np.zeros(0, int), low, high, distance)
