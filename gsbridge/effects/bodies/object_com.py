"""A centre of mass that is offset from the model's."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class ObjectCom(BodyEffect):
    """A centre of mass that is offset from the model's."""

    name = "object_com"
    title = "an offset of the centre of mass"
    hook = "body"
    parameters = (
        Parameter("x", "m", -0.5, 0.5, 0.002, True, "along the body's own axis"),
        Parameter("y", "m", -0.5, 0.5, 0.002, True, "along the body's own axis"),
        Parameter("z", "m", -0.5, 0.5, 0.002, True, "along the body's own axis"),
    )
    figures: ClassVar = {"x": "com_x", "y": "com_y", "z": "com_z"}
    sizes = (1.0, 4.0)
    signature = "wobbles in flight, tips to one side"
    confused_with = ("tracking_offset", "inertia_scale")
    tell_apart = "balance it on an edge along each axis"
