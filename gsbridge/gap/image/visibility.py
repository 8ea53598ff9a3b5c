"""What a view still shows from another place: depths seen from there, and where they end in steps."""

from __future__ import annotations

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array

REACH = 0.03
"""Share of the width round steps of depth that is not compared: what was hidden behind them may come into sight."""

_STEP = 0.02
"""Relative step of depth, beyond a plane's, from which on something may hide behind it."""


def off_steps(depth: Array) -> Array:
    """Pixels of known depth, 0 or not-a-number being unknown, that are no nearer than `REACH` to a step of it. [H, W] bool."""
    depth = np.asarray(depth, np.float64)
    known = np.isfinite(depth) & (depth > 0)
    # The inverse depth of a plane is linear over the image.
    inverse = np.where(known, 1.0 / np.where(known, depth, 1.0), 0.0).astype(np.float32)
    bend = np.abs(cv2.Laplacian(inverse, cv2.CV_32F, borderType=cv2.BORDER_REPLICATE))
    off = ~known | (bend > _STEP * np.maximum(inverse, 1e-6))
    reach = max(1, round(REACH * depth.shape[1]))
    return cv2.dilate(off.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) == 0


def seen_from(depth: Array, camera: Camera, new_from_old: Array) -> Array:
    """Depth that a camera at another place sees, as far as this view knows; 0 where it does not.

    Every pixel falls on the four nearest ones of the new image and the nearest surface wins, so that a surface of which as
    many pixels are seen as before has no holes.

    Args:
        depth: Camera z of every pixel, known everywhere. [H, W].
        camera: Pinhole of both.
        new_from_old: From the axes of this camera to those of the other. [4, 4].

    Returns:
        Camera z in the new view. [H, W] float32.
    """
    rays = camera.pixel_rays()
    places = (rays * np.asarray(depth, np.float64)[..., None]) @ new_from_old[:3, :3].T + new_from_old[:3, 3]
    deep = places[..., 2].ravel()
    ahead = deep > 1e-6
    places, deep = places.reshape(-1, 3)[ahead], deep[ahead].astype(np.float32)
    # OpenCV counts pixel centres from zero.
    across = np.floor(camera.fx * places[:, 0] / deep + camera.cx - 0.5).astype(np.int64)
    down = np.floor(camera.fy * places[:, 1] / deep + camera.cy - 0.5).astype(np.int64)
    out = np.full(camera.height * camera.width, np.inf, np.float32)
    for right in (0, 1):
        for low in (0, 1):
            x, y = across + right, down + low
            kept = (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
            np.minimum.at(out, y[kept] * camera.width + x[kept], deep[kept])
    return np.where(np.isfinite(out), out, 0.0).reshape(camera.height, camera.width)
