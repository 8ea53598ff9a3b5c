"""A wrong rolling resistance, given as a lever arm."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class RollingFriction(BodyEffect):
    """A wrong rolling resistance, given as a lever arm."""

    name = "rolling_friction"
    title = "rolling friction"
    hook = "contact"
    parameters = (Parameter("arm", "m", -0.1, 0.1, 0.001, True, "by which the lever arm differs from the model's"),)
    figures: ClassVar = {"arm": "rolling_friction"}
    sizes = (1.0, 4.0, 16.0)
    signature = "rolls or tumbles too far"
    confused_with = ("table_tilt", "contact_friction")
    tell_apart = "roll it both ways on a level surface"
