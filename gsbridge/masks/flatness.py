"""Find pixels that show the table: their surroundings match other photos when all are projected onto the plane z = 0.

An object of the table's own colour, its shadow and the light it reflects deceive every colour model, but they do not change
parallax. Views far apart are compared, so that a few millimetres of height already destroy the match.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array

_WINDOW = 9
_MATCH = 0.7
_BEST_DEG = 28.0
_LEAST_DEG = 10.0
_OTHERS = 8
_NEEDED = 2
_SHARE = 0.4
"""A pixel must match at least two other photos, and this share of those that show the place: one match may be chance."""
_TEXTURE = 0.006
"""Least standard deviation of a window, 0..1; below it sensor noise decides the correlation."""
_SPECK = 40
"""Matching patches of fewer pixels than this are chance."""


def table_homography(camera: Camera, cam_from_table: Array, other: Camera, other_from_table: Array) -> Array:
    """Homography from pixels of one view to the pixels of another that show the same point of the table plane.

    Args:
        camera: Camera of the view, without distortion.
        cam_from_table: Its pose. [4, 4].
        other: Camera of the other view, without distortion.
        other_from_table: Its pose. [4, 4].

    Returns:
        Homography of pixel coordinates whose integers are pixel centres. [3, 3].
    """
    onto = camera.intrinsics @ cam_from_table[:3][:, [0, 1, 3]]
    other_onto = other.intrinsics @ other_from_table[:3][:, [0, 1, 3]]
    shift = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
    return np.linalg.inv(shift) @ other_onto @ np.linalg.inv(onto) @ shift


def choose_others(centres: Array, target: Array) -> list[list[int]]:
    """Numbers of the views to compare each view with: some 28 degrees apart as seen from `target`. [V, 3], [3]."""
    rays = centres - target
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(rays @ rays.T, -1, 1)))
    out = []
    for row in angles:
        cost = np.abs(np.log(np.maximum(row, 1e-3) / _BEST_DEG))
        usable = np.flatnonzero((row > _LEAST_DEG) & (row < 70.0))
        out.append([int(index) for index in usable[np.argsort(cost[usable], kind="stable")][:_OTHERS]])
    return out


def fine_detail(photo: Array, patch: Array | None = None) -> Array:
    """Grey photo without its smooth shading and without single-pixel noise.

    Shading and contact shadows are alike on object and table; only detail tells them apart.

    Args:
        photo: RGB. [h, w, 3] uint8.
        patch: The only pixels that count, so that pixels beside them leave no trace; None for all. [h, w] bool.

    Returns:
        Detail, typically some thousandths; 0 outside the patch. [h, w] float32.
    """
    grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255.0
    if patch is None:
        return cv2.GaussianBlur(grey, (0, 0), 0.8) - cv2.GaussianBlur(grey, (0, 0), 4.0)
    weight = patch.astype(np.float32)
    fine, coarse = (
        cv2.GaussianBlur(grey * weight, (0, 0), sigma) / np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), 1e-6)
        for sigma in (0.8, 4.0)
    )
    return np.where(patch, fine - coarse, 0.0).astype(np.float32)


def _moments(image: Array) -> tuple[Array, Array]:
    """Mean and variance in a window round each pixel."""
    mean = cv2.blur(image, (_WINDOW, _WINDOW))
    return mean, np.maximum(cv2.blur(image * image, (_WINDOW, _WINDOW)) - mean * mean, 0.0)


def table_pixels(
    index: int, photos: Sequence[Array | None], cameras: Sequence[Camera], poses: Sequence[Array], others: Sequence[int]
) -> Array:
    """Pixels of one photo that match others on the table plane.

    Args:
        index: The photo.
        photos: Grey, 0..1, float32; None where a view does not show the place. [h, w] each.
        cameras: Pinholes of the photos.
        poses: `cam_from_table`. [4, 4] each.
        others: Photos to compare with.

    Returns:
        [h, w] bool; False where there is no evidence.
    """
    photo = photos[index]
    assert photo is not None
    mean, variance = _moments(photo)
    textured = variance > _TEXTURE**2
    matches = np.zeros(photo.shape, np.int32)
    compared = np.zeros(photo.shape, np.int32)
    for other in others:
        source = photos[other]
        if source is None:
            continue
        onto = table_homography(cameras[index], poses[index], cameras[other], poses[other])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        size = photo.shape[::-1]
        laid = cv2.warpPerspective(source, onto, size, flags=flags)
        inside = cv2.warpPerspective(np.ones(source.shape, np.float32), onto, size, flags=flags) > 0.999
        inside = cv2.erode(inside.astype(np.uint8), np.ones((_WINDOW, _WINDOW), np.uint8)) > 0
        other_mean, other_variance = _moments(laid)
        covariance = cv2.blur(photo * laid, (_WINDOW, _WINDOW)) - mean * other_mean
        correlation = covariance / np.sqrt(np.maximum(variance * other_variance, 1e-12))
        usable = inside & textured & (other_variance > _TEXTURE**2)
        compared += usable
        matches += usable & (correlation > _MATCH)
    found = ((matches >= _NEEDED) & (matches >= _SHARE * compared)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(found, connectivity=4)
    large = np.zeros(count, bool)
    large[1:] = stats[1:, cv2.CC_STAT_AREA] >= _SPECK
    # A window may match if only most of it shows the table, so only pixels well within a matching patch are the table's.
    return cv2.erode(large[labels].astype(np.uint8), np.ones((_WINDOW, _WINDOW), np.uint8)) > 0
