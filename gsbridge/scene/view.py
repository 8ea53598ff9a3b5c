"""Images of a composition: the eye-in-hand camera of the simulation."""

from __future__ import annotations

from gsbridge.kernels import njit  # isort: skip  (first: it sets numba's cache folder)

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.scene.editing import Composition, Splats
from gsbridge.splats.rasterize import cpu
from gsbridge.splats.rasterize.cpu import Prepared, Seen

BLACK = (0.0, 0.0, 0.0)

_STEPS = 4095
"""Steps of the lookup tables between encoded values and light; each is a sixteenth of an 8-bit step."""

_LIGHT = linear_from_srgb(np.arange(_STEPS + 1) / _STEPS).astype(np.float32)
_ENCODED = srgb_from_linear((np.arange(_STEPS + 1) / _STEPS) ** 2).astype(np.float32)
"""`_ENCODED[i]` is the encoded value of the light `(i / _STEPS) ** 2`: equal steps in the square root of light."""


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
    """8-bit copy of a float32 image, clamped. [...] -> [...] uint8."""
    out = np.empty(image.shape, np.uint8)
    _bytes_of(np.ascontiguousarray(image, np.float32).reshape(-1), out.reshape(-1))
    return out


@dataclass(frozen=True)
class Shot:
    """One image with the alpha and the depth of its pixels.

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
    splats: Prepared,
    seen: Seen,
    camera: Camera,
    background: Sequence[float] | Array,
    threads: int,
    *,
    antialiased: bool = False,
) -> tuple[Array, Array, Array]:
    """Colour, alpha and depth of the splats that a `gsbridge.scene.groups.GroupedComposition` has in view; see `draw`.

    Args:
        splats: All splats.
        seen: Groups to draw, and the frame of each.
        camera: Pinhole.
        background: Colour where there are no splats, sRGB 0..1. [3].
        threads: Threads to use.
        antialiased: See `gsbridge.splats.rasterize.cpu.render_seen`.
    """
    _require_pinhole(camera)
    behind = np.asarray(background, np.float32)
    return cpu.render_seen(splats, seen, camera=camera, background=behind, threads=threads, antialiased=antialiased)


def pooled(colours: Array, alphas: Array, depths: Array, factor: int) -> tuple[Array, Array, Array]:
    """Shrink images by `factor` along each edge; each new pixel holds the mean light of those that it covers.

    Args:
        colours: Encoded colours; clamped to 0..1 before the mean is taken. [H, W, 3].
        alphas, depths: Alpha, and alpha-weighted sum of camera z, m, as `draw` gives them. [H, W] each.
        factor: Divides H and W.

    Returns:
        Colours, alphas and depths. [H / factor, W / factor, ...].
    """
    height, width = (size // factor for size in alphas.shape)
    out = np.empty((height, width, 3), np.float32), np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    _pool(colours, alphas, depths, factor, *out)
    return out


@njit(error_model="numpy")
def _pool(
    colours: Array, alphas: Array, depths: Array, factor: int, out_colours: Array, out_alphas: Array, out_depths: Array
) -> None:
    """Fill the last three arrays with what `pooled` returns."""
    share, one, steps = np.float32(1.0 / (factor * factor)), np.float32(1.0), np.float32(_STEPS)
    light = np.empty(3, np.float32)
    for i in range(out_alphas.shape[0]):
        for j in range(out_alphas.shape[1]):
            light[:] = 0.0
            alpha, depth = np.float32(0.0), np.float32(0.0)
            for y in range(i * factor, (i + 1) * factor):
                for x in range(j * factor, (j + 1) * factor):
                    alpha += alphas[y, x]
                    depth += depths[y, x]
                    for k in range(3):
                        value = colours[y, x, k]
                        # Every comparison with NaN is false, so that a NaN becomes black, as in `to_bytes`.
                        if value > 0.0:
                            light[k] += _LIGHT[int(min(value, one) * steps + np.float32(0.5))]
            out_alphas[i, j], out_depths[i, j] = alpha * share, depth * share
            for k in range(3):
                out_colours[i, j, k] = _ENCODED[int(np.sqrt(min(light[k] * share, one)) * steps + np.float32(0.5))]


def _require_pinhole(camera: Camera) -> None:
    if not camera.is_pinhole:
        raise ValueError("splats are drawn by a camera without distortion")
