"""A wrong exposure: all light is multiplied by one factor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import GAIN, Shooting


class Exposure(ImageEffect):
    """A wrong exposure: all light is multiplied by one factor."""

    name = "exposure"
    title = "exposure"
    hook = "light"
    parameters = (Parameter("stops", "EV", -3.0, 3.0, 0.1, True, "powers of two on linear light"),)
    signature = "the ratio of photo to picture is one number everywhere, in linear light"
    confused_with = ("response", "black_level", "vignetting")
    tell_apart = "photograph dark and bright patches: a response curve changes their ratio, exposure does not"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Multiply the light."""
        gain = np.float32(2.0 ** values["stops"])
        shooting.on_light(GAIN, lambda light, frame: light * gain)
