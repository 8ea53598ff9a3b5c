"""Visibility from another camera pose: depth maps warped to it, and masks of pixels near steps of depth."""

from __future__ import annotations

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array

REACH = 0.03
"""Distance from steps of depth within which pixels are not compared, as a share of the width: hidden things may appear."""

_STEP = 0.02
"""Second difference of inverse depth, relative to it, above which a pixel counts as a step of depth; zero for a plane."""


def off_steps(depth: Array) -> Array:
    """Mask the pixels of known depth that are farther than `REACH` from any step or gap of the depth. [H, W] bool.

    Args:
        depth: Depth along the camera's z axis, m; 0 or NaN where unknown. [H, W].
    """
    depth = np.asarray(depth, np.float64)
    known = np.isfinite(depth) & (depth > 0)
    # The inverse depth of a plane is linear over the image, so that its Laplacian is zero.
    inverse = np.where(known, 1.0 / np.where(known, depth, 1.0), 0.0).astype(np.float32)
    bend = np.abs(cv2.Laplacian(inverse, cv2.CV_32F, borderType=cv2.BORDER_REPLICATE))
    off = ~known | (bend > _STEP * np.maximum(inverse, 1e-6))
    reach = max(1, round(REACH * depth.shape[1]))
    return cv2.dilate(off.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) == 0


def seen_from(depth: Array, camera: Camera, new_from_old: Array) -> Array:
    """Warp a depth map to another camera pose, with a z-buffer.

    Every pixel is splatted onto the four nearest pixels of the new image, and the nearest surface wins. A surface that keeps
    its size in the image therefore gets no holes.

    Args:
        depth: Depth of every pixel along the camera's z axis, known everywhere, m. [H, W].
        camera: Pinhole camera of both views.
        new_from_old: Transform from the frame of the old camera to that of the new one. [4, 4].

    Returns:
        Depth in the new view, m; 0 where the old view does not show it. [H, W] float32.
    """
    rays = camera.pixel_rays()
    places = (rays * np.asarray(depth, np.float64)[..., None]) @ new_from_old[:3, :3].T + new_from_old[:3, 3]
    deep = places[..., 2].ravel()
    ahead = deep > 1e-6
    places, deep = places.reshape(-1, 3)[ahead], deep[ahead].astype(np.float32)
    # OpenCV puts the centre of the first pixel at zero.
    across = np.floor(camera.fx * places[:, 0] / deep + camera.cx - 0.5).astype(np.int64)
    down = np.floor(camera.fy * places[:, 1] / deep + camera.cy - 0.5).astype(np.int64)
    out = np.full(camera.height * camera.width, np.inf, np.float32)
    for right in (0, 1):
        for low in (0, 1):
            x, y = across + right, down + low
            kept = (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
            np.minimum.at(out, y[kept] * camera.width + x[kept], deep[kept])
    return np.where(np.isfinite(out), out, 0.0).reshape(camera.height, camera.width)
