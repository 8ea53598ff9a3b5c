"""Sensor noise beyond that of the photos without any effect."""

from __future__ import annotations

from collections.abc import Mapping

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import Shooting


class Noise(ImageEffect):
    """Sensor noise beyond that of the photos without any effect."""

    name = "noise"
    title = "sensor noise"
    hook = "sensor"
    parameters = (
        Parameter("read", "1", 0.0, 0.2, 0.01, True, "deviation of encoded values in the dark"),
        Parameter("shot", "1", 0.0, 0.05, 0.0001, True, "variance that is added up to white"),
    )
    signature = "the grain is coarser: neighbouring pixels differ at random, and differently in every photo"
    confused_with = ("defocus",)
    tell_apart = "take two photos from one place and look at their difference"
    noise_only = True

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Add to the variances of read and shot noise."""
        shooting.read_variance += values["read"] ** 2
        shooting.shot_variance += values["shot"]
