"""Rows that are read one after the other."""

from __future__ import annotations

from collections.abc import Mapping

from gsbridge.scene.effects.base import ImageEffect, Parameter
from gsbridge.scene.shooting import Shooting


class RollingShutter(ImageEffect):
    """Rows that are read one after the other."""

    name = "rolling_shutter"
    title = "rolling shutter"
    hook = "time"
    parameters = (Parameter("row_time", "s", -0.002, 0.002, 0.0001, True, "from one row to the next"),)
    signature = "upright edges lean while the camera moves sideways, and stand when it rests"
    confused_with = ("extrinsics", "latency")
    tell_apart = "hold the camera still: nothing leans"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Give every row a time of its own."""
        shooting.row_time += values["row_time"]
