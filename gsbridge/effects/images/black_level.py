"""A wrong black level: a constant is added to all encoded values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import OFFSET, Shooting


class BlackLevel(ImageEffect):
    """A wrong black level: a constant is added to all encoded values."""

    name = "black_level"
    title = "black level"
    hook = "sensor"
    parameters = (Parameter("level", "1", -0.2, 0.2, 0.01, True, "added to encoded values"),)
    signature = "the difference is one number everywhere, in the dark too"
    confused_with = ("exposure", "response", "saturation")
    tell_apart = "photograph with the lens covered"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Add the level to the encoded values."""
        level = np.float32(values["level"])
        shooting.on_sensor(OFFSET, lambda encoded: encoded + level)
