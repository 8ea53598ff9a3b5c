"""Cameras and poses that came with photos."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsbridge.cameras import Camera, camera_problem, pose_problem
from gsbridge.errors import InputError
from gsbridge.geometry import Array

_REMEDY = "Export it again, or take the photos alone as `images:`"


@dataclass(frozen=True)
class KnownView:
    """Camera and pose that came with a photo. `cam_from_world`: OpenCV axes, arbitrary unit. [4, 4]."""

    camera: Camera
    cam_from_world: Array


def checked_view(view: KnownView, source: str | Path, photo: str) -> KnownView:
    """Return a view unchanged if its camera and pose are possible.

    Args:
        view: Camera and pose.
        source: File that they were read from.
        photo: Name of the photo.

    Raises:
        InputError: A number is not finite or not plausible, or the pose is no rotation and translation.
    """
    problem = camera_problem(view.camera) or pose_problem(view.cam_from_world)
    if problem:
        raise InputError(
            source, f"the view of {photo} is damaged: {problem}", "Export it again, or take the photos alone as `images:`"
        )
    return view
