"""Radial distortion of the lens."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import Shooting


class Distortion(ImageEffect):
    """Radial distortion of the lens."""

    name = "distortion"
    title = "lens distortion"
    hook = "geometry"
    parameters = (
        Parameter("k1", "1", -0.4, 0.4, 0.01, True, "displacement by the cube of the distance"),
        Parameter("k2", "1", -0.4, 0.4, 0.02, True, "displacement by its fifth power"),
    )
    signature = "edges are displaced along the radius, by its third power"
    confused_with = ("focal", "extrinsics")
    tell_apart = "compare corners with half way to them: focal length displaces in proportion, distortion by the third power"

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Add to the distortion coefficients."""
        shooting.distortion = shooting.distortion + np.array([values["k1"], values["k2"]])
