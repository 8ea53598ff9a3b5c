"""A wrong coefficient of restitution, the share of the normal speed that an impact returns."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class Restitution(BodyEffect):
    """A wrong coefficient of restitution, the share of the normal speed that an impact returns."""

    name = "restitution"
    title = "restitution"
    hook = "contact"
    parameters = (Parameter("restitution", "1", -1.0, 1.0, 0.1, True, "by which the coefficient differs from the model's"),)
    figures: ClassVar = {"restitution": "restitution"}
    sizes = (1.0, 3.0, 6.0)
    signature = "wrong height after each impact"
    confused_with = ("contact_softness", "gravity_scale")
    tell_apart = "drop it from two heights and film the rebounds"
