"""The hidden truth of the mirror's films, for scoring only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from gsbridge.cameras import Camera, camera_centre
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.geometry import Array


@dataclass(frozen=True)
class Truth:
    """What the film studio knew.

    Args:
        camera: True camera of the film, with distortion.
        poses: `cam_from_table` of each frame, by file name, m. [4, 4].
        target: Name of the filmed object, None for a background.
    """

    camera: Camera
    poses: dict[str, Array]
    target: str | None

    def centres(self) -> dict[str, Array]:
        """Camera positions by frame name, table frame, m. [3]."""
        return {name: camera_centre(pose) for name, pose in self.poses.items()}


def read_truth(path: str | Path) -> Truth:
    """Read `truth.json`.

    Raises:
        InputError: The file is missing or damaged.
    """
    content = read_json(path)
    try:
        poses = {frame["name"]: np.array(frame["cam_from_table"], dtype=np.float64) for frame in content["frames"]}
        if any(pose.shape != (4, 4) for pose in poses.values()):
            raise ValueError("a pose is no 4x4 matrix")
        return Truth(Camera.from_json(content["camera"]), poses, content.get("object"))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(path, f"the truth is damaged ({error!r})", "Film the scene again") from error


def undistort_mask(mask: Array, camera: Camera, pinhole: Camera) -> Array:
    """A mask filmed through a lens, as the undistorted camera would see it.

    Args:
        mask: Film pixels, 0..1. [H, W].
        camera: Camera of the film, with distortion: the *estimated* one, since the estimated mask lies in images that
            were undistorted with it.
        pinhole: Camera of the undistorted image.

    Returns:
        Bilinear mask in the undistorted image; outside the film it is 0. [H', W'] float32.

    Raises:
        ValueError: The mask has another size than the camera.
    """
    if mask.shape != (camera.height, camera.width):
        raise ValueError(f"the mask is {mask.shape[1]}x{mask.shape[0]}, its camera {camera.width}x{camera.height}")
    # OpenCV counts pixel centres from 0, we from 0.5.
    filmed, flat = (replace(c, cx=c.cx - 0.5, cy=c.cy - 0.5).intrinsics for c in (camera, pinhole))
    size = (pinhole.width, pinhole.height)
    maps = cv2.initUndistortRectifyMap(filmed, np.array(camera.distortion), None, flat, size, cv2.CV_32FC1)
    source = np.ascontiguousarray(mask, dtype=np.float32)
    return cv2.remap(source, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)


def mask_iou(mask: Array, reference: Array) -> float:
    """Intersection over union of two masks, cut at 0.5; 1 where both are empty. [H, W] each."""
    a, b = np.asarray(mask) >= 0.5, np.asarray(reference) >= 0.5
    union = np.count_nonzero(a | b)
    return float(np.count_nonzero(a & b) / union) if union else 1.0
