"""A sensor that reads its rows one after the other."""

from __future__ import annotations

from collections.abc import Mapping

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import Shooting


class RollingShutter(ImageEffect):
    """A sensor that reads its rows one after the other."""

    name = "rolling_shutter"
    title = "rolling shutter"
    hook = "time"
    parameters = (Parameter("row_time", "s", -0.002, 0.002, 0.0001, True, "from one row to the next"),)
    signature = "upright edges lean while the camera moves sideways, and stand when it rests"
    confused_with = ("extrinsics", "latency")
    tell_apart = "hold the camera still: nothing leans"
    reason = "an episode's pictures show all rows at one moment"
    instead = "Use a camera with a global shutter or a faster readout, or slow the arm down"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Add to the time between rows."""
        shooting.row_time += values["row_time"]
