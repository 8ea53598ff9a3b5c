"""A wrong friction coefficient between body and surface."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class ContactFriction(BodyEffect):
    """A wrong friction coefficient between body and surface."""

    name = "contact_friction"
    title = "contact friction"
    hook = "contact"
    parameters = (Parameter("friction", "1", -2.0, 2.0, 0.05, True, "by which the coefficient differs from the model's"),)
    figures: ClassVar = {"friction": "friction"}
    sizes = (1.0, 2.5, 6.0, 12.0)
    signature = "errors grow while the body slides; the stopping distance is wrong"
    confused_with = ("table_tilt", "restitution", "rolling_friction")
    tell_apart = "slide it along a level surface both ways and measure where it stops; the mass has no effect"
