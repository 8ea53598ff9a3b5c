"""A shutter that is open while the camera moves."""

from __future__ import annotations

from collections.abc import Mapping

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import Shooting


class MotionBlur(ImageEffect):
    """A shutter that is open while the camera moves."""

    name = "motion_blur"
    title = "motion blur"
    hook = "time"
    parameters = (Parameter("exposure_time", "s", 0.0, 0.15, 0.02, True, "how long the shutter is open"),)
    signature = "edges across the motion are soft, those along it are sharp; nothing when the camera rests"
    confused_with = ("defocus", "latency")
    tell_apart = "hold the camera still: motion blur goes, defocus stays"
    sizes = (1.0, 2.5)
    reason = "an episode's pictures show one moment, not a stretch of time"
    instead = "Shorten the exposure and light the scene more"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Add to the exposure time."""
        shooting.exposure_time += values["exposure_time"]
