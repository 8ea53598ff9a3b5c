"""A wrong white balance: red and blue light are multiplied by factors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import GAIN, Shooting


class WhiteBalance(ImageEffect):
    """A wrong white balance: red and blue light are multiplied by factors."""

    name = "white_balance"
    title = "white balance"
    hook = "light"
    parameters = (
        Parameter("red", "1", -0.7, 0.7, 0.05, True, "logarithm of the gain of red"),
        Parameter("blue", "1", -0.7, 0.7, 0.05, True, "logarithm of the gain of blue"),
    )
    signature = "ratios of colours are off by the same factors everywhere"
    confused_with = ("hue_cast", "saturation")
    tell_apart = "map the ratio of red to green over the image: white balance is flat, a local light is not"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Multiply red and blue."""
        gains = np.exp(np.array([values["red"], 0.0, values["blue"]])).astype(np.float32)
        shooting.on_light(GAIN, lambda light, frame: light * gains)
