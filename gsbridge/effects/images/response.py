"""A wrong response curve: encoded values are raised to a power."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import RESPONSE, Shooting


class Response(ImageEffect):
    """A wrong response curve: encoded values are raised to a power."""

    name = "response"
    title = "response curve"
    hook = "sensor"
    parameters = (Parameter("curve", "1", -0.8, 0.8, 0.05, True, "logarithm of the exponent"),)
    signature = "middle greys differ, black and white do not"
    confused_with = ("exposure", "black_level", "saturation")
    tell_apart = "photograph a grey ramp: exposure shifts it, a response curve bends it"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Raise encoded values to a power."""
        power = np.exp(values["curve"])
        shooting.on_sensor(RESPONSE, lambda encoded: np.clip(encoded, 0.0, 1.0) ** power)
