"""Lamps that flicker with the mains: brightness alternates between photos or between bands of rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import GAIN, CameraFrame, Shooting
from gsbridge.geometry import Array


class Flicker(ImageEffect):
    """Lamps that flicker with the mains: brightness alternates between photos or between bands of rows."""

    name = "flicker"
    title = "flicker"
    hook = "light"
    timed = True
    parameters = (
        Parameter("sine", "1", -0.8, 0.8, 0.03, True, "amplitude of the sine of the time stamps"),
        Parameter("cosine", "1", -0.8, 0.8, 0.03, True, "amplitude of the cosine"),
        Parameter("frequency", "Hz", 1.0, 130.0, 100.0, False, "of the light"),
        Parameter("readout", "s", 0.0, 0.001, 0.0, False, "from one row to the next"),
    )
    signature = "all of a photo is brighter or darker, from photo to photo, or in bands of rows"
    confused_with = ("exposure",)
    tell_apart = "photograph without moving, many times: exposure does not change"
    places: ClassVar = {"frequency": (50.0, 60.0, 100.0, 120.0), "readout": (0.0, 2.5e-4)}
    reason = "an episode's pictures have no light that changes within a picture or from one to the next"
    instead = "Light the scene with lamps that do not flicker, or make the exposure a multiple of the mains' period"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Multiply every row by the brightness of the lamps at its readout time."""
        sine, cosine, readout = values["sine"], values["cosine"], values["readout"]
        pace = 2.0 * np.pi * values["frequency"]

        def vary(light: Array, frame: CameraFrame) -> Array:
            height = frame.camera.height
            phase = pace * (frame.time + (np.arange(height) + 0.5 - 0.5 * height) * readout)
            gain = 1.0 + sine * np.sin(phase) + cosine * np.cos(phase)
            return light * gain.astype(np.float32)[:, None, None]

        shooting.on_light(GAIN, vary)
