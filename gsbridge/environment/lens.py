"""A model's image effects, applied to the pictures that a policy learns from.

Effects are defined relative to the calibrated wrist camera, so they come after the camera's response. That response's gamma,
black level and clipping act on encoded values, while effects act on light; the picture is therefore encoded and decoded again
in between, in float32. It is rounded to 8 bits only at the end.
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
        camera: Nominal pinhole of the pictures.

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
        """Apply the effects to a picture that was drawn without them, and round it. uint8 [H, W, 3].

        Args:
            values: sRGB, not rounded; clamped to 0..1 before anything else, and NaN counts as black. They are drawn with the
                attribute `camera`, which is wider than the photo if the lens distorts. [H', W', 3] float32.
            cam_from_table: Pose that `pose` returned, with the effects on the mount. [4, 4].
            rng: Random numbers for the noise; none are drawn if there is no noise.
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
        """Return camera z at which each pixel sees the table's plane, m; shadow effects ignore what stands on it. [H, W]."""
        rays = self.nominal.pixel_rays()
        down = rays @ cam_from_table[:3, 2]
        height = float(cam_from_table[:3, 3] @ cam_from_table[:3, 2])
        return np.asarray(np.clip(height / np.where(np.abs(down) < 1e-6, 1e-6, down), 0.0, 100.0), np.float32)
