"""A wrong camera pose relative to its mount."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from gsbridge.effects.images.base import ImageEffect, Parameter
from gsbridge.effects.images.camera_pipeline import Shooting

_TURNS = (-0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15)
"""Angles from which a search starts, rad; one step moves the point at which a wrist camera looks by a few centimetres."""


class Extrinsics(ImageEffect):
    """A wrong camera pose relative to its mount."""

    name = "extrinsics"
    title = "camera mount"
    hook = "geometry"
    parameters = (
        Parameter("x", "m", -0.1, 0.1, 0.002, True, "to the right, in the camera"),
        Parameter("y", "m", -0.1, 0.1, 0.002, True, "to the bottom, in the camera"),
        Parameter("z", "m", -0.1, 0.1, 0.002, True, "to the front, in the camera"),
        Parameter("about_x", "rad", -0.2, 0.2, 0.004, True, "turn about its axis x"),
        Parameter("about_y", "rad", -0.2, 0.2, 0.004, True, "turn about its axis y"),
        Parameter("about_z", "rad", -0.2, 0.2, 0.004, True, "turn about its axis z"),
    )
    far = tuple({"about_x": x, "about_y": y} for x, y in product(_TURNS, repeat=2) if x or y)
    signature = "edges are displaced, near things more than far ones, the same way in every pose"
    confused_with = ("focal", "latency", "distortion")
    tell_apart = (
        "stop and look: a late picture is right when the camera rests, a shifted mount is not; photograph near and far things"
    )

    def apply(self, shooting: Shooting, values: Mapping[str, float]) -> None:
        """Move and turn the camera in its own frame."""
        # The camera's pose in its nominal frame, whose inverse maps points to the frame of the moved camera.
        turn = Rotation.from_rotvec([values["about_x"], values["about_y"], values["about_z"]]).as_matrix()
        moved = np.eye(4)
        moved[:3, :3] = turn.T
        moved[:3, 3] = -turn.T @ np.array([values["x"], values["y"], values["z"]])
        shooting.mount = moved @ shooting.mount
