"""Response of the simulated wrist camera: from a rendered image to the one the sensor would deliver."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.sim.model import Camera


def respond(image: Array, camera: Camera, rng: np.random.Generator) -> Array:
    """What the camera makes of an image.

    Args:
        image: Rendered image, sRGB. uint8 [H, W, 3].
        camera: Its response. With a noise of zero the answer is a table look-up, with neutral values the image itself.
        rng: Source of the noise; left alone where there is none.

    Returns:
        uint8 [H, W, 3].
    """
    linear, table, neutral = _tables(camera)
    if camera.shot_noise == 0 and camera.read_noise == 0:
        return image if neutral else table[image, np.arange(3)]
    light = linear[image, np.arange(3)]
    spread = np.sqrt(camera.shot_noise * light + camera.read_noise**2)
    return _encode(light + spread * rng.standard_normal(light.shape), camera)


@lru_cache(maxsize=16)
def _tables(camera: Camera) -> tuple[Array, Array, bool]:
    """Light, and without noise the delivered byte, for every byte of a picture, [256, 3] each; whether it is the same byte."""
    gains = camera.gain * np.array([camera.red_gain, 1.0, camera.blue_gain])
    linear = linear_from_srgb(np.arange(256) / 255.0)[:, None] * gains
    table = _encode(linear, camera)
    return linear, table, bool((table == np.arange(256)[:, None]).all())


def _encode(linear: Array, camera: Camera) -> Array:
    """Linear light to 8 bits; clamped before it is stored, so that bright pixels never wrap around."""
    encoded = srgb_from_linear(np.clip(linear, 0.0, 1.0)) ** camera.gamma + camera.black_level
    return np.rint(255.0 * np.clip(encoded, 0.0, 1.0)).astype(np.uint8)
