"""A wrong focal length."""

from __future__ import annotations

from collections.abc import Mapping

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import Shooting


class Focal(ImageEffect):
    """A wrong focal length."""

    name = "focal"
    title = "focal length"
    hook = "geometry"
    parameters = (Parameter("change", "1", -0.2, 0.2, 0.005, True, "share by which it is longer"),)
    signature = "edges are displaced along the radius, in proportion to it"
    confused_with = ("extrinsics", "distortion")
    tell_apart = "photograph from several distances: moving the camera displaces near things more"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Multiply the focal lengths."""
        shooting.focal *= 1.0 + values["change"]
