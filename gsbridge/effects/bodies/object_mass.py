"""A body that is heavier or lighter than the model, with the same relative distribution of mass."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class ObjectMass(BodyEffect):
    """A body that is heavier or lighter than the model, with the same relative distribution of mass."""

    name = "object_mass"
    title = "a wrong mass of the body"
    hook = "body"
    parameters = (Parameter("share", "1", -0.9, 4.0, 0.3, True, "by which the mass differs, of the model's"),)
    figures: ClassVar = {"share": "mass"}
    relative = True
    sizes = (1.0,)
    signature = "none in free flight and sliding; another answer to forces and soft contacts"
    confused_with = ("contact_softness", "steady_force")
    tell_apart = "weigh it"
