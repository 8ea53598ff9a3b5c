"""Image effects of a model in the pictures that a policy learns from: what the gap of pictures named, drawn.

An effect is told against the wrist camera as it was calibrated, so it comes after the camera's response, whose gamma, black
level and clipping act on encoded values. Between the two the picture is therefore encoded once and decoded again, in float32;
it is rounded to 8 bits at the end, and nowhere before.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.effects.images import IMAGE_EFFECTS
from gsbridge.effects.images.camera_pipeline import CameraFrame, Shooting
from gsbridge.effects.registry import Applied
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb
from gsbridge.scene.photograph import bent, develop, drawn_through, with_noise
from gsbridge.scene.view import to_bytes
from gsbridge.sim.camera_values import clamped


class WristLens:
    """The wrist camera as a model's effects change it.

    Args:
        effects: Effects of the model on pictures; without any, pictures stay as they are.
        camera: Pinhole of the pictures, as it is thought to be.

    Attributes:
        plain: Whether there is no effect, so that a picture needs no lens.
    """

    def __init__(self, effects: Sequence[Applied], camera: Camera) -> None:
        self.nominal, self.how, self.plain = camera, Shooting(), not effects
        for effect in effects:
            IMAGE_EFFECTS[effect.name].apply(self.how, effect.parameters)
        self.camera, self._pad = drawn_through(camera, self.how)
        how = self.how
        self._noisy = how.read_variance > 0.0 or how.shot_variance > 0.0
        self._develops = bool(how.light or how.sensor or how.blur or self._pad)

    def pose(self, cam_from_table: Array) -> Array:
        """Pose of the camera with the effects on its mount. [4, 4]."""
        return self.how.mount @ cam_from_table

    def photo(self, values: Array, cam_from_table: Array, rng: np.random.Generator) -> Array:
        """Apply the effects to a picture of the camera without them, and round it. uint8 [H, W, 3].

        Args:
            values: sRGB, not rounded; clamped to 0..1 before anything else, and NaN counts as black. Drawn with `camera`, which
                is wider than the photo where the lens bends. [H', W', 3] float32.
            cam_from_table: Where the camera really sits. [4, 4].
            rng: Random numbers for the noise; none are drawn where there is no noise.
        """
        values = clamped(values)
        if self._develops:
            light = linear_from_srgb(values)
            if self._pad:
                light = bent(light, np.zeros(light.shape[:2], np.float32), self.camera, self._pad, self.how.distortion)[0]
            frame = CameraFrame(self.nominal, 0.0, self._table_depths(cam_from_table), cam_from_table)
            values = develop(light, frame, self.how)
        return to_bytes(with_noise(values, self.how, rng) if self._noisy else values)

    def _table_depths(self, cam_from_table: Array) -> Array:
        """Camera z at which each pixel sees the table, m: shadows lie there. What stands on it is thin for them. [H, W]."""
        rays = self.nominal.pixel_rays()
        down = rays @ cam_from_table[:3, 2]
        height = float(cam_from_table[:3, 3] @ cam_from_table[:3, 2])
        return np.asarray(np.clip(height / np.where(np.abs(down) < 1e-6, 1e-6, down), 0.0, 100.0), np.float32)
