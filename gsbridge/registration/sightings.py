"""Sightings of the board in single photos: pose of the board from the tags found, and rejection of tags that do not fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.photogrammetry.board import MIN_TAGS, Board


@dataclass(frozen=True)
class Sighting:
    """The board in one photo.

    Args:
        points: Tag corners in the board frame, at the printed size, m. [K, 3].
        pixels: Positions of the corners in the photo, px with pixel centres at +0.5, distortion included. [K, 2].
        cam_from_board: Pose of the board from this photo alone, m. [4, 4].
        rms_px: Root mean square reprojection error of that pose, px.
        tags: Number of tags used.
    """

    points: Array
    pixels: Array
    cam_from_board: Array
    rms_px: float
    tags: int


def sight_board(tags: Mapping[int, Array], board: Board, camera: Camera, gate_px: float) -> Sighting | str:
    """Find the pose of the board from the tags of one photo.

    Args:
        tags: Corners by tag id, px, as `find_tags` gives them. [4, 2] each.
        board: Layout of the board.
        camera: Intrinsics, with distortion.
        gate_px: Reprojection error, px, above which tags are left out, one at a time, the worst first.

    Returns:
        The sighting, or a short phrase that says why there is none.
    """
    layout = board.corners()
    kept = sorted(tag for tag in tags if tag in layout)
    while len(kept) >= MIN_TAGS:
        points = np.concatenate([layout[tag] for tag in kept])
        pixels = np.concatenate([tags[tag] for tag in kept])
        pose = _flat_pose(points, pixels, camera)
        if pose is None:
            return "the tags give no pose"
        errors = camera.project(points @ pose[:3, :3].T + pose[:3, 3]) - pixels
        squares = np.nan_to_num((errors**2).sum(1), nan=np.inf)
        rms = float(np.sqrt(squares.mean()))
        if rms <= gate_px:
            return Sighting(points, pixels, pose, rms, len(kept))
        del kept[int(np.argmax(squares.reshape(-1, 4).sum(1)))]
    found = len([tag for tag in tags if tag in layout])
    if found < MIN_TAGS:
        return f"{found} of {len(layout)} tags found, {MIN_TAGS} are needed"
    return f"its tags do not fit the board's layout within {gate_px:g} px"


def _flat_pose(points: Array, pixels: Array, camera: Camera) -> Array | None:
    """Return `cam_from_board` of a flat target, refined from the better of its two candidates; None without one. [4, 4]."""
    # OpenCV has pixel centres at integers, gsbridge at +0.5.
    k = camera.intrinsics.copy()
    k[:2, 2] -= 0.5
    seen = np.ascontiguousarray(pixels - 0.5)
    distortion = np.array(camera.distortion)
    best, least = None, np.inf
    # IPPE gives both candidates of a flat target, but for corners without noise it occasionally returns NaN.
    for method in (cv2.SOLVEPNP_IPPE, cv2.SOLVEPNP_ITERATIVE):
        try:
            count, turns, shifts, _ = cv2.solvePnPGeneric(points, seen, k, distortion, flags=method)
        except cv2.error:
            continue
        for turn, shift in zip(turns[:count], shifts[:count], strict=True):
            refined = cv2.solvePnPRefineLM(points, seen, k, distortion, turn.copy(), shift.copy())
            # The refinement, too, can return NaN where there is nothing left to refine, so the unrefined pose competes as well.
            for vector, place in ((turn, shift), refined):
                pose = np.eye(4)
                pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(vector)[0], place.ravel()
                error = camera.project(points @ pose[:3, :3].T + pose[:3, 3]) - pixels
                cost = float(np.nan_to_num((error**2).sum(), nan=np.inf))
                if cost < least:
                    best, least = pose, cost
    return best
