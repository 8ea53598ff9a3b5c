"""A wrong moment of inertia, with the mass unchanged."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class InertiaScale(BodyEffect):
    """A wrong moment of inertia, with the mass unchanged."""

    name = "inertia_scale"
    title = "a wrong moment of inertia"
    hook = "body"
    parameters = (Parameter("share", "1", -0.9, 4.0, 0.2, True, "by which it differs, of the model's"),)
    figures: ClassVar = {"share": "inertia"}
    relative = True
    sizes = (1.0, 3.0)
    signature = "turns too much or too little at impacts"
    confused_with = ("object_size", "restitution")
    tell_apart = "let it swing as a pendulum"
