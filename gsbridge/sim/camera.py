"""Response of the simulated wrist camera: from a rendered image to the one the sensor would deliver."""

from __future__ import annotations

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
    levels = np.arange(256) / 255.0
    gains = camera.gain * np.array([camera.red_gain, 1.0, camera.blue_gain])
    linear = linear_from_srgb(levels)[:, None] * gains
    if camera.shot_noise == 0 and camera.read_noise == 0:
        if (gains == 1).all() and camera.gamma == 1 and camera.black_level == 0:
            return image
        table = _encode(linear, camera)
        return np.stack([table[image[..., channel], channel] for channel in range(3)], axis=-1)
    light = np.stack([linear[image[..., channel], channel] for channel in range(3)], axis=-1)
    spread = np.sqrt(camera.shot_noise * light + camera.read_noise**2)
    return _encode(light + spread * rng.standard_normal(light.shape), camera)


def _encode(linear: Array, camera: Camera) -> Array:
    """Linear light to 8 bits; clamped before it is stored, so that bright pixels never wrap around."""
    encoded = srgb_from_linear(np.clip(linear, 0.0, 1.0)) ** camera.gamma + camera.black_level
    return np.rint(255.0 * np.clip(encoded, 0.0, 1.0)).astype(np.uint8)
