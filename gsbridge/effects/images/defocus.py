"""A lens out of focus: every point becomes a spot."""

from __future__ import annotations

from collections.abc import Mapping

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import Shooting


class Defocus(ImageEffect):
    """A lens out of focus: every point becomes a spot."""

    name = "defocus"
    title = "defocus"
    hook = "light"
    parameters = (Parameter("sigma", "px", 0.0, 6.0, 0.5, True, "deviation of the spot"),)
    signature = "all edges are soft in all directions, also when the camera rests"
    confused_with = ("motion_blur",)
    tell_apart = "hold the camera still; photograph the scene as it was when its splats were made, since splats are soft too"
    sizes = (1.0, 2.5)

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Blur the light."""
        shooting.blur += values["sigma"] ** 2
