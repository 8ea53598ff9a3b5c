"""A body that is larger or smaller than the model, with the same mass properties."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class ObjectSize(BodyEffect):
    """A body that is larger or smaller than the model, with the same mass properties."""

    name = "object_size"
    title = "a wrong size of the body"
    hook = "body"
    parameters = (Parameter("share", "1", -0.5, 1.0, 0.01, True, "by which its lengths differ, of the model's"),)
    figures: ClassVar = {"share": "size"}
    relative = True
    sizes = (1.0, 4.0)
    signature = "rests too high or low, touches too early or late, in every attitude alike"
    confused_with = ("table_height", "tracking_scale")
    tell_apart = "measure it with a calliper"
    reason = "the simulated object has the shape of its mesh and splats, which were measured together"
    instead = "Film the object again with the board in view, or correct the scale of its scene"
