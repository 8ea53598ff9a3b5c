"""A mass at the last link that the model does not contain."""

from collections.abc import Mapping

import numpy as np

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class Payload(JointEffect):
    """A point mass at a position in the frame of the last link."""

    name = "payload"
    title = "an unknown payload"
    hook = "body"
    scope = "mechanism"
    parameters = (
        Parameter("mass", "kg", 0.0, 20.0, 0.05, True, "of the payload"),
        Parameter("x", "m", -1.0, 1.0, 0.0, False, "its place in the frame of the last link", weighted_by="mass"),
        Parameter("y", "m", -1.0, 1.0, 0.0, False, "", weighted_by="mass"),
        Parameter("z", "m", -1.0, 1.0, 0.0, False, "", weighted_by="mass"),
    )
    sizes = (1.0, 10.0)
    signature = "like weight, growing towards the base, in all joints"
    confused_with = ("link_mass", "gravcomp")
    tell_apart = "static poses; turn the wrist"

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return payloads of typical mass at the frame's origin and 0.15 m from it along each axis, both ways."""
        places = ((0, 0, 0), (0.15, 0, 0), (-0.15, 0, 0), (0, 0.15, 0), (0, -0.15, 0), (0, 0, 0.15), (0, 0, -0.15))
        return tuple({"mass": 0.05, "x": float(x), "y": float(y), "z": float(z)} for x, y, z in places)

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Add the point mass."""
        setup.add_payload(values["mass"], np.array([values["x"], values["y"], values["z"]]))
