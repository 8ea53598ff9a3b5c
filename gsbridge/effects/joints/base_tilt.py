"""A base that is not level."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter
from gsbridge.geometry import Array


class BaseTilt(JointEffect):
    """A base that is tilted about its two horizontal axes.

    On a floor these are the x and y axis of the base. On a wall or a ceiling they are what x and y become by the smallest turn
    that takes -z to the direction of gravity: a turn about gravity itself changes nothing.
    """

    name = "base_tilt"
    title = "a tilted base"
    hook = "body"
    scope = "mechanism"
    parameters = (
        Parameter(
            "about_x",
            "rad",
            -0.3,
            0.3,
            0.02,
            True,
            "turn of the base about its x axis, on a wall about the horizontal axis in its place",
        ),
        Parameter(
            "about_y",
            "rad",
            -0.3,
            0.3,
            0.02,
            True,
            "turn of the base about its y axis, on a wall about the horizontal axis in its place",
        ),
    )
    signature = "a constant that depends on the pose, also in joints that carry no weight"
    confused_with = ("encoder_offset", "effort_offset", "payload")
    tell_apart = "turn the first joint by 180 degrees"

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return a typical tilt about each axis, with both signs."""
        return tuple({"about_x": a, "about_y": b} for a, b in ((0.02, 0), (-0.02, 0), (0, 0.02), (0, -0.02)))

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Turn gravity by the opposite angle, which is the same as turning the base."""
        turn = Rotation.from_rotvec(_horizontal(setup.gravity).apply([values["about_x"], values["about_y"], 0.0]))
        setup.gravity = turn.inv().apply(setup.gravity)


def _horizontal(gravity: Array) -> Rotation:
    """Return the smallest turn that takes -z to the direction of gravity; none where there is no gravity. [3]."""
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return Rotation.identity()
    down = np.asarray(gravity) / size
    axis, along = np.cross([0.0, 0.0, -1.0], down), -float(down[2])
    sine = float(np.linalg.norm(axis))
    if sine == 0.0:
        return Rotation.identity() if along > 0 else Rotation.from_rotvec([np.pi, 0.0, 0.0])
    return Rotation.from_rotvec(np.arctan2(sine, along) * axis / sine)
