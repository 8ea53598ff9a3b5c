"""Cameras and poses that came with photos, and what no camera and no pose can be."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.errors import InputError
from gsbridge.geometry import Array

_FOCAL = (0.05, 100.0)
"""Focal lengths that there are, in longer sides of the picture: from wider than any lens without fisheye to a telescope's."""
_REMEDY = "Export it again, or take the photos alone as `images:`"
_LARGEST_SIDE = 100_000
_LARGEST_DISTORTION = 100.0
_SKEW = 1e-2
"""Largest deviation of a stated rotation from one. Files round to some five digits; scale and shear show in the first two."""


@dataclass(frozen=True)
class KnownView:
    """Camera and pose that came with a photo. `cam_from_world`: OpenCV axes, arbitrary unit. [4, 4]."""

    camera: Camera
    cam_from_world: Array


def checked_view(view: KnownView, source: str | Path, photo: str) -> KnownView:
    """Return a view as it is, if there can be such a camera in such a pose.

    Args:
        view: Camera and pose.
        source: File that they were read from.
        photo: Name of the photo.

    Raises:
        InputError: A number is none or out of every range, or the pose is no rotation and translation.
    """
    problem = _camera_problem(view.camera) or _pose_problem(view.cam_from_world)
    if problem:
        raise InputError(
            source, f"the view of {photo} is damaged: {problem}", "Export it again, or take the photos alone as `images:`"
        )
    return view


def _camera_problem(camera: Camera) -> str | None:
    """What is wrong with a camera; None where nothing is."""
    longer = max(camera.width, camera.height)
    if not 0 < min(camera.width, camera.height) <= longer <= _LARGEST_SIDE:
        return f"a picture of {camera.width} x {camera.height} px"
    for name, value in (("fx", camera.fx), ("fy", camera.fy)):
        if not _FOCAL[0] * longer <= value <= _FOCAL[1] * longer:
            return f"a focal length {name} of {value:g} px in a picture of {camera.width} x {camera.height} px"
    for name, value, side in (("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)):
        if not -side <= value <= 2 * side:
            return f"a principal point at {name} = {value:g} px in a picture of {camera.width} x {camera.height} px"
    if not all(abs(value) <= _LARGEST_DISTORTION for value in camera.distortion):
        return f"a distortion of {', '.join(f'{value:g}' for value in camera.distortion)}"
    return None


def _pose_problem(pose: Array) -> str | None:
    """What is wrong with a pose; None where nothing is."""
    if not np.isfinite(pose).all():
        return "its pose holds a number that is none"
    rotation = pose[:3, :3]
    scale = float(np.linalg.norm(rotation) / np.sqrt(3))
    if not np.abs(rotation @ rotation.T - np.eye(3)).max() <= _SKEW:
        return f"its pose is no rotation and translation (its axes are {scale:.4g} long, or not at right angles)"
    if np.linalg.det(rotation) < 0.0:
        return "its pose mirrors the world"
    return None
