"""A wrong resistance to spinning about the contact normal, given as a lever arm."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class SpinningFriction(BodyEffect):
    """A wrong resistance to spinning about the contact normal, given as a lever arm."""

    name = "spinning_friction"
    title = "spinning friction"
    hook = "contact"
    parameters = (Parameter("arm", "m", -0.1, 0.1, 0.001, True, "by which the lever arm differs from the model's"),)
    figures: ClassVar = {"arm": "spinning_friction"}
    sizes = (1.0, 4.0, 16.0)
    signature = "spins about the vertical too long"
    confused_with = ("contact_friction", "rolling_friction")
    tell_apart = "spin it on the spot"
