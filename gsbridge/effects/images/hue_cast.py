"""A coloured lamp that moves with the camera and tints part of the image, such as a gripper's indicator light."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import SURFACE, CameraFrame, Shooting
from gsbridge.geometry import Array


class HueCast(ImageEffect):
    """A coloured lamp that moves with the camera and tints part of the image, such as a gripper's indicator light."""

    name = "hue_cast"
    title = "coloured light"
    hook = "light"
    parameters = (
        Parameter("red", "1", 0.0, 4.0, 0.05, True, "red light that it adds, in shares of what is there"),
        Parameter("green", "1", 0.0, 4.0, 0.05, True, "green light that it adds, in shares of what is there"),
        Parameter("blue", "1", 0.0, 4.0, 0.05, True, "blue light that it adds, in shares of what is there"),
        Parameter("x", "half diagonals", -1.2, 1.2, 0.0, False, "its middle, right of the image's"),
        Parameter("y", "half diagonals", -1.2, 1.2, 0.0, False, "the same, below"),
        Parameter("radius", "half diagonals", 0.1, 1.5, 0.4, False, "deviation of the spot"),
    )
    signature = "one part of the image is brighter and coloured, the same part in every photo"
    confused_with = ("white_balance", "vignetting", "shadow")
    tell_apart = "switch the lamp off"
    places: ClassVar = {"x": (-0.55, 0.0, 0.55), "y": (-0.4, 0.0, 0.4), "radius": (0.4,)}

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Add coloured light in a Gaussian spot, in proportion to the light that is there."""
        colour = np.array([values["red"], values["green"], values["blue"]], np.float32)
        x, y, radius = values["x"], values["y"], values["radius"]

        def shine(light: Array, frame: CameraFrame) -> Array:
            across, down = frame.plane
            spot = np.exp(-0.5 * ((across - x) ** 2 + (down - y) ** 2) / radius**2).astype(np.float32)
            return light * (1.0 + spot[..., None] * colour)

        shooting.on_light(SURFACE, shine)
