"""A lens that passes less light towards the corners."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import LENS, CameraFrame, Shooting
from gsbridge.geometry import Array


class Vignetting(ImageEffect):
    """A lens that passes less light towards the corners."""

    name = "vignetting"
    title = "vignetting"
    hook = "light"
    parameters = (
        Parameter("strength", "1", 0.0, 2.0, 0.05, True, "loss at the corner: light is divided by the square of one plus this"),
        Parameter("x", "half diagonals", -0.5, 0.5, 0.0, False, "where it is brightest, right of the middle"),
        Parameter("y", "half diagonals", -0.5, 0.5, 0.0, False, "the same, below the middle"),
    )
    signature = "corners are darker, the same in every photo"
    confused_with = ("shadow", "exposure")
    tell_apart = "turn the camera about its line of sight: vignetting turns with it, shadows stay"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Divide the light by a function of the distance from the brightest point."""
        strength, x, y = np.float32(values["strength"]), values["x"], values["y"]

        def darken(light: Array, frame: CameraFrame) -> Array:
            across, down = frame.plane
            square = ((across - x) ** 2 + (down - y) ** 2).astype(np.float32)
            return light / ((1.0 + strength * square) ** 2)[..., None]

        shooting.on_light(LENS, darken)
