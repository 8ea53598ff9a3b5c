"""Images that are older than their time stamps."""

from __future__ import annotations

from collections.abc import Mapping

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import Shooting


class Latency(ImageEffect):
    """Images that are older than their time stamps."""

    name = "latency"
    title = "latency of the camera"
    hook = "time"
    parameters = (Parameter("delay", "s", -0.2, 0.4, 0.01, True, "by which they are older"),)
    signature = "edges are displaced while the camera moves, as if it lagged behind, and fit when it rests"
    confused_with = ("extrinsics", "rolling_shutter")
    tell_apart = "stop and look: the difference vanishes at rest"
    reason = "an episode's pictures show the moment at which they are taken"
    instead = "Reduce the delay of the camera's driver, or wait for each picture before the policy acts"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Add to the delay, so that photos are taken from the camera's earlier pose."""
        shooting.delay += values["delay"]
