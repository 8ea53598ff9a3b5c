"""A wrong saturation: the distance of every colour from grey is multiplied by a factor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import COLOUR, Shooting

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Shares of red, green and blue in the brightness of linear light (Rec. 709)."""


class Saturation(ImageEffect):
    """A wrong saturation: the distance of every colour from grey is multiplied by a factor."""

    name = "saturation"
    title = "saturation"
    hook = "light"
    parameters = (Parameter("change", "1", -0.9, 0.9, 0.05, True, "by which distances from grey of the same luminance grow"),)
    signature = "the difference grows with how colourful a pixel is and vanishes on grey"
    confused_with = ("white_balance", "response", "black_level")
    tell_apart = "photograph a grey card: saturation does nothing to it"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Move colours away from, or towards, the grey of the same luminance."""
        mix = 1.0 + values["change"]
        matrix = (mix * np.eye(3) + (1.0 - mix) * np.outer(np.ones(3), LUMINANCE)).astype(np.float32)
        shooting.on_light(COLOUR, lambda light, frame: light @ matrix.T)
