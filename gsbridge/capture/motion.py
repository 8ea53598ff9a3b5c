"""Sharpness and image motion of a film's frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from gsbridge.geometry import Array
from gsbridge.logs import ProgressLog

WIDTH = 640
"""Width at which frames are judged, px: one floor of sharpness then holds for every camera."""

_COMMIT_PX = 2.0
_MIN_TRACKS = 12


@dataclass(frozen=True)
class FrameMotion:
    """Motion and quality of one frame, known before keyframes are chosen.

    Args:
        sharpness: Variance of the Laplacian at `WIDTH`, grey levels squared.
        brightness: Mean grey level, 0..255.
        path_px: Image motion summed from the first frame, px of the full image.
    """

    sharpness: float
    brightness: float
    path_px: float


def small_grey(image: Array) -> Array:
    """Grey image at `WIDTH`. uint8 BGR [H, W, 3] -> uint8 [H', 640]."""
    height, width = image.shape[:2]
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    # Enlarging would blur; small films are judged as they are.
    if width <= WIDTH:
        return grey
    return cv2.resize(grey, (WIDTH, max(1, round(height * WIDTH / width))), interpolation=cv2.INTER_AREA)


def sharpness_of(grey: Array) -> float:
    """Variance of the Laplacian, grey levels squared. uint8 [H, W]."""
    return float(cv2.Laplacian(grey.astype(np.float32), cv2.CV_32F).var())


def image_motion(previous: Array, current: Array) -> float | None:
    """Median displacement of tracked corners, px; None where too few can be tracked. uint8 [H, W] each."""
    corners = cv2.goodFeaturesToTrack(previous, maxCorners=300, qualityLevel=0.01, minDistance=8)
    if corners is None or len(corners) < _MIN_TRACKS:
        return None
    moved, found, _ = cv2.calcOpticalFlowPyrLK(previous, current, corners, None, winSize=(21, 21), maxLevel=3)  # type: ignore[call-overload]  # None asks OpenCV for new points
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(current, previous, moved, None, winSize=(21, 21), maxLevel=3)  # type: ignore[call-overload]  # as above
    # Forth and back must agree, or the track has jumped.
    good = (found.ravel() == 1) & (found_back.ravel() == 1) & (np.linalg.norm(back - corners, axis=-1).ravel() < 1.0)
    if good.sum() < _MIN_TRACKS:
        return None
    return float(np.median(np.linalg.norm(moved - corners, axis=-1).ravel()[good]))


def measure(frames: Iterable[tuple[float, Array]]) -> tuple[list[FrameMotion], tuple[int, int]]:
    """Judge all frames of a film in one pass.

    Motion is measured from an anchor frame that moves on only after `_COMMIT_PX`: sensor noise on a static film then adds up to
    nothing, and identical frames share one place on the path.

    Args:
        frames: Time, s, and BGR image of each frame, with a `declared` count where known. [H, W, 3] uint8 each.

    Returns:
        The judgement of each frame; height and width of the images, px.
    """
    progress = ProgressLog(max(1, getattr(frames, "declared", 0)), "measure motion")
    motions: list[FrameMotion] = []
    size = (0, 0)
    anchor: Array | None = None
    base = 0.0
    for _, image in frames:
        grey = small_grey(image)
        size = image.shape[:2]
        unit = size[1] / grey.shape[1]
        path = base
        if anchor is None:
            anchor = grey
        else:
            step = image_motion(anchor, grey)
            if step is None:
                # Tracks are lost in blur, darkness or a cut: the phase of the whole image is coarser but survives.
                (dx, dy), _ = cv2.phaseCorrelate(anchor.astype(np.float64), grey.astype(np.float64))
                step = float(np.hypot(dx, dy)) if anchor.std() > 2.0 and grey.std() > 2.0 else 0.0
            path = base + step
            if step >= _COMMIT_PX:
                base, anchor = path, grey
        motions.append(FrameMotion(sharpness_of(grey), float(grey.mean()), path * unit))
        progress.update()
    # Jitter round an anchor must not run backwards.
    peak = 0.0
    for index, motion in enumerate(motions):
        peak = max(peak, motion.path_px)
        motions[index] = FrameMotion(motion.sharpness, motion.brightness, peak)
    return motions, size
