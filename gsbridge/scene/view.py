"""Images of a composition: the eye-in-hand camera of the simulation."""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.scene.editing import Composition, Splats
from gsbridge.splats.rasterize import cpu
from gsbridge.splats.rasterize.cpu import Prepared, Seen

BLACK = (0.0, 0.0, 0.0)


@njit(error_model="numpy")
def _bytes_of(values: Array, out: Array) -> None:
    """Clamp to 0..1 and round to 8 bits; NaN becomes 0. Flat arrays."""
    for i in range(values.shape[0]):
        value = values[i] * np.float32(255.0) + np.float32(0.5)
        # Overlapping splats may add up to more than white; without the clamp a byte would wrap round to black.
        if not value > np.float32(0.0):
            value = np.float32(0.0)
        out[i] = np.uint8(min(value, np.float32(255.0)))


def to_bytes(image: Array) -> Array:
    """8-bit copy of a float32 image, clamped. Any shape."""
    out = np.empty(image.shape, np.uint8)
    _bytes_of(np.ascontiguousarray(image, np.float32).reshape(-1), out.reshape(-1))
    return out


@dataclass(frozen=True)
class Shot:
    """One image with what the rasteriser knows besides colour.

    Args:
        pixels: sRGB. [H, W, 3] uint8.
        alphas: Share of light from splats, 0..1. [H, W] float32.
        depths: Alpha-weighted mean camera z, m; 0 where nothing is. [H, W] float32.
    """

    pixels: Array
    alphas: Array
    depths: Array

    @property
    def coverage(self) -> float:
        """Mean alpha: 1 where no hole shows the background colour."""
        return float(self.alphas.mean(dtype=np.float64))


def shoot(
    composition: Composition, camera: Camera, cam_from_world: Array, background: Sequence[float] = BLACK, threads: int = 1
) -> Shot:
    """Image, alpha and depth of a composition as it is posed now.

    Args:
        composition: Splats.
        camera: Pinhole.
        cam_from_world: Pose, OpenCV axes. [4, 4].
        background: Colour where there are no splats, sRGB 0..1. [3].
        threads: Threads; environments run side by side, so one each.

    Raises:
        ValueError: The camera has distortion.
    """
    return shot_of(*draw(composition.splats, camera, cam_from_world, background, threads))


def shot_of(colours: Array, alphas: Array, depths: Array) -> Shot:
    """A shot from the three images that `draw` gives.

    Args:
        colours: Encoded colours, not clamped. [H, W, 3].
        alphas: Share of light from splats, 0..1. [H, W].
        depths: Alpha-weighted sum of camera z, m. [H, W].
    """
    return Shot(to_bytes(colours), alphas, depths / np.maximum(alphas, np.float32(1e-6)))


def render(
    composition: Composition, camera: Camera, cam_from_world: Array, background: Sequence[float] = BLACK, threads: int = 1
) -> Array:
    """Image of a composition as it is posed now.

    Args:
        composition: Splats.
        camera: Pinhole.
        cam_from_world: Pose, OpenCV axes. [4, 4].
        background: Colour where there are no splats, sRGB 0..1. [3].
        threads: Threads to use.

    Returns:
        sRGB. [H, W, 3] uint8.

    Raises:
        ValueError: The camera has distortion.
    """
    return to_bytes(draw(composition.splats, camera, cam_from_world, background, threads)[0])


def draw(
    splats: Splats, camera: Camera, cam_from_world: Array, background: Sequence[float], threads: int
) -> tuple[Array, Array, Array]:
    """Colour, alpha and depth of splats, not yet rounded to bytes.

    Args:
        splats: The splats.
        camera: Pinhole.
        cam_from_world: Pose, OpenCV axes. [4, 4].
        background: Colour where there are no splats, sRGB 0..1. [3].
        threads: Threads to use.

    Returns:
        Encoded colours, not clamped [H, W, 3], alpha [H, W], and the alpha-weighted sum of camera z, m. [H, W].

    Raises:
        ValueError: The camera has distortion.
    """
    _require_pinhole(camera)
    return cpu.render(
        splats.means,
        splats.quats,
        splats.scales,
        splats.opacities,
        splats.colours,
        camera=camera,
        cam_from_table=cam_from_world,
        background=np.asarray(background, np.float32),
        threads=threads,
        harmonics=splats.harmonics,
    )


def draw_seen(
    splats: Prepared, seen: Seen, camera: Camera, background: Sequence[float] | Array, threads: int
) -> tuple[Array, Array, Array]:
    """Colour, alpha and depth of what a `gsbridge.scene.groups.GroupedComposition` sees of its splats, as `draw` gives them.

    Args:
        splats: All splats.
        seen: Groups to draw, and the frame of each.
        camera: Pinhole.
        background: Colour where there are no splats, sRGB 0..1. [3].
        threads: Threads to use.
    """
    _require_pinhole(camera)
    return cpu.render_seen(splats, seen, camera=camera, background=np.asarray(background, np.float32), threads=threads)


def _require_pinhole(camera: Camera) -> None:
    if not camera.is_pinhole:
        raise ValueError("splats are drawn by a camera without distortion")
