"""Intrinsics shared by the captures of one camera, from the board's tags."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.errors import InputError, StageError
from gsbridge.files import read_json, write_stage
from gsbridge.geometry import Array
from gsbridge.images import read_image_u8
from gsbridge.logs import ProgressLog
from gsbridge.photogrammetry.board import MIN_TAGS, Board, find_tags

logger = logging.getLogger("gsbridge")

MIN_VIEWS = 6
GOOD_VIEWS = 20
DOUBTFUL_RMS_PX, WORST_RMS_PX = 0.8, 3.0
"""Residuals at the board, px, from which a camera is doubtful and above which it is rejected. Two lenses or zooms taken for one
leave several px; the noise of the corners alone leaves 0.1 to 0.4."""

MAX_VIEWS = 100
"""Largest number of views that are solved together: the solver's cost grows with its cube, the precision with its root."""

Match = tuple[Array, Array]
"""Corners of one view: board frame, m [N, 3], and image, px with pixel centres at +0.5 [N, 2]."""


def calibrate_camera(keyframe_folders: Sequence[tuple[Path, Path]], board: Board, out_json: Path) -> None:
    """Estimate the intrinsics, with distortion, of a camera that filmed several captures with the board.

    A flat background alone does not determine its camera; the captures of one camera together do.

    Args:
        keyframe_folders: For each capture, its folder of keyframes and its `keyframes.json`.
        board: Layout of the tags.
        out_json: Record of the camera.

    Raises:
        InputError: The captures differ in image size.
        StageError: The board is seen in too few views, or no camera fits them.
    """
    matches, size = _find_matches(keyframe_folders, board)
    if len(matches) < MIN_VIEWS:
        raise StageError(
            "calibration",
            f"the board is seen with {MIN_TAGS} or more tags in {len(matches)} photos, {MIN_VIEWS} are needed",
            "Lay the board in view while filming, flat and well lit, or leave the camera of these scenes unset",
        )
    camera, rms, kept = solve(matches, size)
    reasons = [] if kept >= GOOD_VIEWS else [f"{kept} views of the board; {GOOD_VIEWS} or more are advised"]
    # The limit is in pixels, because corners are found to a fraction of a pixel at any size of the photos.
    if rms > WORST_RMS_PX:
        raise StageError(
            "calibration",
            f"no camera fits the board: a residual of {rms:.1f} px is left, 0.3 are usual",
            "Lenses, zooms or stabilisers of the captures differ, or the board is bent: name a camera for each of them",
        )
    if rms > DOUBTFUL_RMS_PX:
        reasons.append(
            f"the camera leaves a residual of {rms:.2f} px at the board, 0.3 are usual: zoom, lens or stabiliser of the "
            "captures may differ, or the board is not flat"
        )
    logger.info("camera from %d of %d views: focal %.1f px, residual %.3f px", kept, len(matches), camera.fx, rms)
    write_stage(
        out_json,
        reasons=reasons,
        packages=["opencv-python-headless"],
        camera=camera.to_json(),
        rms_px=rms,
        views=kept,
        views_found=len(matches),
        captures=len(keyframe_folders),
    )


def solve(matches: Sequence[Match], size: tuple[int, int]) -> tuple[Camera, float, int]:
    """Fit a camera to views of a flat target, leaving out views that do not fit.

    More than `MAX_VIEWS` views are split into groups of at most that many. The result is the mean of the groups' cameras, which
    is as precise as one large solution.

    Args:
        matches: Corners of each view: on the board, m [N, 3], and in the image, px [N, 2].
        size: Width and height of the images, px.

    Returns:
        The camera, the residual of the kept views (root mean square, px), and their number.

    Source: Zhang, IEEE PAMI 22(11), 2000, as in OpenCV.
    """
    groups = max(-(-len(matches) // MAX_VIEWS), 1)
    found = [_solve_group(matches[first::groups], size) for first in range(groups)]
    views = np.array([kept for _, _, kept in found])
    figures = np.average([figures for figures, _, _ in found], axis=0, weights=views)
    fx, fy, cx, cy, k1, k2, p1, p2 = (float(value) for value in figures)
    rms = float(np.sqrt(np.average([rms**2 for _, rms, _ in found], weights=views)))
    # OpenCV has pixel centres at integers, gsbridge at +0.5.
    return Camera(*size, fx, fy, cx + 0.5, cy + 0.5, (k1, k2, p1, p2)), rms, int(views.sum())


def _solve_group(matches: Sequence[Match], size: tuple[int, int]) -> tuple[Array, float, int]:
    """OpenCV's fx, fy, cx, cy, k1, k2, p1, p2 from views solved together; the residual (px) and number of the views kept."""
    kept = list(matches)
    while True:
        boards = [b.astype(np.float32) for b, _ in kept]
        pixels = [(p - 0.5).astype(np.float32) for _, p in kept]
        criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-10)
        # The two None ask OpenCV for a first guess of its own.
        rms, k, distortion, _, _, _, _, errors = cv2.calibrateCameraExtended(  # type: ignore[call-overload]
            boards, pixels, size, None, None, flags=cv2.CALIB_FIX_K3, criteria=criteria
        )
        errors = errors.ravel()
        good = errors <= 3.0 * np.median(errors) + 1e-3
        if good.all() or good.sum() < MIN_VIEWS:
            break
        kept = [match for match, ok in zip(kept, good, strict=True) if ok]
    return np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], *distortion.ravel()[:4]]), float(rms), len(kept)


def _find_matches(keyframe_folders: Sequence[tuple[Path, Path]], board: Board) -> tuple[list[Match], tuple[int, int]]:
    """Corners of the board in all photos that show enough of it, and the image size."""
    layout = board.corners()
    matches: list[Match] = []
    size: tuple[int, int] | None = None
    names = [(Path(folder), [frame["name"] for frame in read_json(record)["frames"]]) for folder, record in keyframe_folders]
    progress = ProgressLog(sum(len(frames) for _, frames in names), "find the board")
    for folder, frames in names:
        for name in frames:
            image = read_image_u8(folder / name)
            here = (image.shape[1], image.shape[0])
            size = size or here
            if here != size:
                raise InputError(
                    folder / name,
                    f"this photo has {here[0]} x {here[1]} pixels, others of the same camera {size[0]} x {size[1]}",
                    "Give captures at another size or zoom a camera of their own in config.yaml",
                )
            tags = find_tags(image, board)
            progress.update()
            if len(tags) >= MIN_TAGS:
                ids = sorted(tags)
                matches.append((np.concatenate([layout[i] for i in ids]), np.concatenate([tags[i] for i in ids])))
    return matches, size or (0, 0)


def read_camera(path: str | Path) -> Camera:
    """Read the record of `calibrate_camera`.

    Raises:
        InputError: The file is damaged.
    """
    content = read_json(path)
    try:
        return Camera.from_json(content["camera"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(path, f"the camera is damaged ({error})", "Delete it and run the calibration again") from error


def optional_camera(path: str | Path | None) -> Camera | None:
    """The calibrated camera of a scene, or None where the scene names no shared camera."""
    return read_camera(path) if path else None
