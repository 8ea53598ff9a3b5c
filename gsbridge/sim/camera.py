"""Response of the simulated wrist camera: from a rendered image to the one the sensor would deliver."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, srgb_from_linear
from gsbridge.sim.model import CameraModel


@dataclass(frozen=True)
class CameraResponse:
    """Response that turns a picture of the splats into one of the wrist camera, in the terms of the model's `camera`.

    Args:
        gain, red_gain, blue_gain: Factors on linear light: all channels, red, blue.
        gamma: Exponent on the encoded value.
        black_level: Added to the encoded value.
    """

    gain: float = 1.0
    red_gain: float = 1.0
    blue_gain: float = 1.0
    gamma: float = 1.0
    black_level: float = 0.0

    def after(self, model: CameraModel) -> CameraModel:
        """Combine this response with the model's camera; the model's changes come on top."""
        return replace(
            model,
            gain=model.gain * self.gain,
            red_gain=model.red_gain * self.red_gain,
            blue_gain=model.blue_gain * self.blue_gain,
            gamma=model.gamma * self.gamma,
            black_level=model.black_level + self.black_level,
        )

    @property
    def gains(self) -> Array:
        """Factors on linear red, green and blue. [3]."""
        return self.gain * np.array([self.red_gain, 1.0, self.blue_gain])

    def encode(self, light: Array) -> Array:
        """Encoded value, not yet clamped, of light behind the gains. [..., 3] -> [..., 3]."""
        return np.asarray(srgb_from_linear(np.clip(light, 0.0, 1.0)) ** self.gamma + self.black_level)

    def apply(self, encoded: Array) -> Array:
        """Encoded value that the wrist camera delivers for an encoded value of the splats. [..., 3]."""
        # Light is never quite 0, so that a fit has a slope (in gamma) in the dark, too.
        return self.encode(np.maximum(linear_from_srgb(np.asarray(encoded, np.float64)) * self.gains, 1e-6))

    def undo(self, encoded: Array) -> Array:
        """Encoded value of the splats for one of the wrist camera, 0..1. [..., 3]."""
        value = np.clip(np.asarray(encoded, np.float64) - self.black_level, 0.0, 1.0) ** (1.0 / self.gamma)
        return srgb_from_linear(np.clip(linear_from_srgb(value) / self.gains, 0.0, 1.0))


def respond(image: Array, camera: CameraModel, rng: np.random.Generator) -> Array:
    """Apply the camera's response to an image.

    Args:
        image: Rendered image, sRGB. uint8 [H, W, 3].
        camera: Response of the camera. Without noise the result is a table look-up; with neutral values it is the image
            itself.
        rng: Source of the noise; not used if there is no noise.

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
def _tables(camera: CameraModel) -> tuple[Array, Array, bool]:
    """Tabulate light and the byte delivered without noise for every byte, [256, 3] each; tell whether all bytes are kept."""
    linear = linear_from_srgb(np.arange(256) / 255.0)[:, None] * _of(camera).gains
    table = _encode(linear, camera)
    return linear, table, bool((table == np.arange(256)[:, None]).all())


def _encode(linear: Array, camera: CameraModel) -> Array:
    """Linear light to 8 bits; clamped before it is stored, so that bright pixels never wrap around."""
    return np.rint(255.0 * np.clip(_of(camera).encode(linear), 0.0, 1.0)).astype(np.uint8)


def _of(camera: CameraModel) -> CameraResponse:
    """Return the response of a model's camera without its noise."""
    return CameraResponse(camera.gain, camera.red_gain, camera.blue_gain, camera.gamma, camera.black_level)
