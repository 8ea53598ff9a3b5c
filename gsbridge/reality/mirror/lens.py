"""The mirror's phone camera: fixed intrinsics with distortion, and the warp of pinhole renderings to its pictures."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.images import srgb_from_linear

_FIELD_OF_VIEW_DEG = 62.0
_DISTORTION = (0.04, -0.03, 0.0004, -0.0006)
_PRINCIPAL_OFFSET = (3.7 / 640, -2.9 / 640)  # of the width, from the middle
_BORDER = 8  # px rendered beyond the film on every side
SENSOR_NOISE = 0.6 / 255
"""Standard deviation of the sensor's noise, added to the encoded value (0..1)."""


def phone(width: int, height: int) -> Camera:
    """Return the phone camera at a film size; all films use the same phone, so that captures share intrinsics.

    Args:
        width, height: Film size, px.
    """
    focal = width / 2 / np.tan(np.radians(_FIELD_OF_VIEW_DEG) / 2)
    return Camera(
        width,
        height,
        focal,
        focal * 1.001,
        width / 2 + _PRINCIPAL_OFFSET[0] * width,
        height / 2 + _PRINCIPAL_OFFSET[1] * width,
        _DISTORTION,
    )


def _undistorted_rays(film: Camera) -> Array:
    """Return x, y (at z = 1) of the ray of each pixel centre of a distorted camera. [H, W, 2]."""
    k1, k2, p1, p2 = film.distortion
    u, v = np.meshgrid(np.arange(film.width) + 0.5, np.arange(film.height) + 0.5)
    xd, yd = (u - film.cx) / film.fx, (v - film.cy) / film.fy
    x, y = xd.copy(), yd.copy()
    for _ in range(40):  # the fixed-point iteration gains more than a digit per round at a phone's slight distortion
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * k2)
        x, y = (
            (xd - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
            (yd - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial,
        )
    return np.stack([x, y], axis=-1)


@dataclass(frozen=True)
class PhoneLens:
    """Warp of a centred pinhole rendering to the picture of a distorted camera.

    Args:
        film: The distorted camera, whose pictures make the film.
        pinhole: The camera to render: square pixels, principal point in the middle, slightly larger than the film.
        x, y: Position of each film pixel in the rendering, px with OpenCV's pixel centres at integers. [H, W] float32.
    """

    film: Camera
    pinhole: Camera
    x: Array
    y: Array

    @classmethod
    def of(cls, film: Camera) -> PhoneLens:
        """Build the lens with the distortion of a camera."""
        rays = _undistorted_rays(film)
        focal = film.fx
        half = np.ceil(np.abs(rays * focal).reshape(-1, 2).max(0)) + _BORDER
        width, height = int(2 * half[0]), int(2 * half[1])
        pinhole = Camera(width, height, focal, focal, width / 2, height / 2)
        # OpenCV has pixel centres at integers.
        x = rays[..., 0] * focal + pinhole.cx - 0.5
        y = rays[..., 1] * focal + pinhole.cy - 0.5
        return cls(film, pinhole, x.astype(np.float32), y.astype(np.float32))

    def warp(self, rendering: Array) -> Array:
        """Warp a rendering (linear light or coverage) to the film. [h, w] or [h, w, 3] -> [H, W(, 3)] float32."""
        return cv2.remap(
            np.ascontiguousarray(rendering, dtype=np.float32), self.x, self.y, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT
        )

    def expose(self, rendering: Array, rng: np.random.Generator, gain: Array | float = 1.0) -> Array:
        """Make an 8-bit photo of a rendering: warp in linear light, exposure, sRGB encoding, sensor noise.

        Args:
            rendering: Linear light. [h, w, 3].
            rng: Random numbers of the noise.
            gain: Exposure factor of each channel. [3] or one number.

        Returns:
            The photo. [H, W, 3] uint8.
        """
        encoded = srgb_from_linear(np.clip(gain * self.warp(rendering), 0, 1))
        noisy = encoded + SENSOR_NOISE * rng.standard_normal(encoded.shape, dtype=np.float32)
        return np.rint(np.clip(noisy, 0, 1) * 255).astype(np.uint8)
