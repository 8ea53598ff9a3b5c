"""A grey shadow that is fixed to the table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import SURFACE, CameraFrame, Shooting
from gsbridge.geometry import Array


class Shadow(ImageEffect):
    """A grey shadow that is fixed to the table.

    Its position is computed with the nominal pinhole camera. If the focal length or distortion is wrong as well, the shadow is
    misplaced in the image by the same amount.
    """

    name = "shadow"
    title = "shadow"
    hook = "light"
    parameters = (
        Parameter("strength", "1", 0.0, 0.97, 0.05, True, "share of the light that is missing in its middle"),
        Parameter("x", "m", -1.0, 1.0, 0.0, False, "its middle, in the world"),
        Parameter("y", "m", -1.0, 1.0, 0.0, False, "the same"),
        Parameter("radius", "m", 0.01, 0.5, 0.08, False, "of the disc"),
        Parameter("softness", "1", 0.03, 0.6, 0.2, False, "width of its edge, in shares of the radius"),
    )
    signature = "one place of the table is darker, of no colour, and stays where it is when the camera moves"
    confused_with = ("vignetting", "hue_cast")
    tell_apart = "move the camera: the shadow stays on the table; move the lamp: it moves"
    places: ClassVar = {"x": (-0.15, -0.05, 0.05, 0.15), "y": (-0.15, -0.05, 0.05, 0.15), "radius": (0.08,)}

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Darken a disc with a soft edge, like the shadow that a lamp overhead casts on the table."""
        strength, x, y = values["strength"], values["x"], values["y"]
        radius, edge = values["radius"], values["radius"] * values["softness"]

        def darken(light: Array, frame: CameraFrame) -> Array:
            points = frame.points
            inside = (radius - np.hypot(points[..., 0] - x, points[..., 1] - y)) / edge
            shade = strength / (1.0 + np.exp(-np.clip(2.0 * inside, -40.0, 40.0)))
            return light * (1.0 - shade).astype(np.float32)[..., None]

        shooting.on_light(SURFACE, darken)
