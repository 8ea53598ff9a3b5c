"""Response of the simulated wrist camera in float32, for pictures that are processed further before they are rounded.

The function for bytes is `gsbridge.sim.camera.respond`.
"""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb
from gsbridge.sim.camera import CameraResponse
from gsbridge.sim.model import CameraModel


def clamped(image: Array) -> Array:
    """Clamp to 0..1; NaN becomes 0. [...] -> [...] of the same type."""
    # `fmax` returns the number if one of its two arguments is NaN.
    x = np.asarray(image)
    return np.asarray(np.minimum(np.fmax(x, x.dtype.type(0)), x.dtype.type(1)))


def respond_unrounded(values: Array, camera: CameraModel, rng: np.random.Generator) -> Array:
    """Apply the camera's response to values that are not rounded, and do not round the result either.

    Args:
        values: Rendered image, sRGB, clamped to 0..1 before anything else; NaN counts as black. float32 [H, W, 3].
        camera: Response of the camera. With neutral values and without noise the answer is the clamped image.
        rng: Source of the noise, with the same draws as in `respond`; not used if there is no noise.

    Returns:
        Encoded values that the camera delivers, 0..1. float32 [H, W, 3].
    """
    values = clamped(values)
    response = CameraResponse(camera.gain, camera.red_gain, camera.blue_gain, camera.gamma, camera.black_level)
    noisy = camera.shot_noise > 0 or camera.read_noise > 0
    if not noisy and response == CameraResponse():
        return values
    light = linear_from_srgb(values) * response.gains.astype(np.float32)
    if noisy:
        spread = np.sqrt(camera.shot_noise * light + camera.read_noise**2)
        light = (light + spread * rng.standard_normal(light.shape)).astype(np.float32)
    return clamped(response.encode(light))
