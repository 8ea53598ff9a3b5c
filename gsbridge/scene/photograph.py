"""Simulated photos of splats with the exposures, lens, light and sensor that a `Shooting` describes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from scipy.special import ive

from gsbridge.cameras import Camera
from gsbridge.effects.images.camera_pipeline import CameraFrame, Shooting
from gsbridge.geometry import Array
from gsbridge.images import srgb_from_linear

EXPOSURES = 7
"""Number of pictures over the time in which the shutter is open."""

STRIPS = 24
"""Strips of rows that a rolling shutter reads at one time."""

MARGIN = 0.15
"""Share of the image that is drawn beyond its edges, for lenses that show more than a pinhole."""

BLURS = (0.7, 1.4)
"""Standard deviations of the blurred copies that `softened` sharpens a picture against, px."""


def drawn_through(camera: Camera, shooting: Shooting) -> tuple[Camera, int]:
    """The pinhole to draw with, and the number of pixels by which its image is wider than the photo on each side.

    Args:
        camera: The photo's assumed camera.
        shooting: Gives the actual focal length, relative to the assumed one, and the distortion of its lens.
    """
    camera = replace(camera, fx=camera.fx * shooting.focal, fy=camera.fy * shooting.focal)
    if not shooting.distortion.any():
        return camera, 0
    pad = round(MARGIN * max(camera.width, camera.height))
    return camera.cropped(-pad, -pad, camera.width + 2 * pad, camera.height + 2 * pad), pad


def develop(light: Array, frame: CameraFrame, shooting: Shooting) -> Array:
    """Make an encoded photo without noise from linear light, as lens, light and sensor do.

    Args:
        light: Linear light. [H, W, 3].
        frame: Camera, time, depths and pose of the photo.
        shooting: What lens, light and sensor are like.

    Returns:
        sRGB 0..1. [H, W, 3] float32.
    """
    steps = sorted(shooting.light, key=lambda item: item[0])
    for _, step in (item for item in steps if item[0] < 1):
        light = step(light, frame)
    if shooting.softness:
        light = np.maximum(softened(light, shooting.softness), 0.0)
    if shooting.blur > 0.0:
        light = blurred(light, float(np.sqrt(shooting.blur)))
    for _, step in (item for item in steps if item[0] >= 1):
        light = step(light, frame)
    values = srgb_from_linear(np.clip(light, 0.0, 1.0))
    for _, turn in sorted(shooting.sensor, key=lambda item: item[0]):
        values = turn(values)
    return np.clip(values, 0.0, 1.0).astype(np.float32)


def with_noise(photos: Array, shooting: Shooting, rng: np.random.Generator) -> Array:
    """Add noise to photos, and clamp them without rounding.

    Args:
        photos: Photos without noise, encoded, 0..1. [...].
        shooting: Gives the variances of read and shot noise.
        rng: Random numbers.

    Returns:
        Encoded values, 0..1, in the shape of `photos`. float32.
    """
    spread = np.sqrt(shooting.read_variance + shooting.shot_variance * photos)
    return np.clip(photos + spread * rng.standard_normal(photos.shape), 0.0, 1.0).astype(np.float32)


def blurred(image: Array, sigma: float) -> Array:
    """Blur an image with a Gaussian of standard deviation `sigma`, px; beyond the edges their pixels are repeated. [H, W, 3].

    The discrete Gaussian kernel has exactly this deviation, even below a pixel, where a sampled Gaussian has not.

    Source: Lindeberg, IEEE PAMI 12(3), 1990.
    """
    reach = int(np.ceil(4.0 * sigma)) + 1
    kernel = ive(np.arange(-reach, reach + 1), sigma**2)
    kernel = (kernel / kernel.sum()).astype(np.float32)
    return cv2.sepFilter2D(image, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)


def softened(image: Array, amounts: Sequence[float]) -> Array:
    """Sharpen an image against its blurred copies, one amount per `BLURS`; negative amounts soften it. [H, W, 3]."""
    out = image
    for amount, sigma in zip(amounts, BLURS, strict=True):
        out = out + np.float32(amount) * (image - blurred(image, sigma))
    return out


def straightening(far: Array, distortion: Array) -> Array:
    """Factors that undo a radial distortion at normalised radii on the sensor. [...] -> [...].

    Args:
        far: Distorted radii, in focal lengths. [...].
        distortion: k1, k2 of the OPENCV model. [2].
    """
    k1, k2 = distortion
    straight = far.copy()
    for _ in range(8):
        # Newton's steps on r (1 + k1 r^2 + k2 r^4) = far; the slope is kept off zero where the distortion folds over.
        square = straight**2
        slope = np.maximum(1.0 + 3.0 * k1 * square + 5.0 * k2 * square**2, 0.2)
        straight = straight - (straight * (1.0 + k1 * square + k2 * square**2) - far) / slope
    return straight / np.maximum(far, 1e-12)


def bent(light: Array, depths: Array, camera: Camera, pad: int, distortion: Array) -> tuple[Array, Array]:
    """Distort a pinhole picture and its depths as a lens does, and crop them to the photo. [h, w, 3], [h, w].

    Args:
        light: Linear light. [H, W, 3].
        depths: Depth of each pixel, m. [H, W].
        camera: Pinhole of picture and depths, from `drawn_through`.
        pad: Pixels by which the picture is wider than the photo on each side.
        distortion: k1, k2 of the OPENCV model. [2].
    """
    height, width = light.shape[0] - 2 * pad, light.shape[1] - 2 * pad
    x = (np.arange(width) + 0.5 + pad - camera.cx) / camera.fx
    y = ((np.arange(height) + 0.5 + pad - camera.cy) / camera.fy)[:, None]
    factor = straightening(np.hypot(x, y), distortion)
    # OpenCV counts pixel centres from zero.
    across = (x * factor * camera.fx + camera.cx - 0.5).astype(np.float32)
    down = (y * factor * camera.fy + camera.cy - 0.5).astype(np.float32)
    edge = cv2.BORDER_REPLICATE
    bent = cv2.remap(light, across, down, cv2.INTER_CUBIC, borderMode=edge)
    return np.maximum(bent, 0.0), cv2.remap(depths, across, down, cv2.INTER_NEAREST, borderMode=edge)
