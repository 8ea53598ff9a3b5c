"""A surface, or a contact margin, that is higher or lower than the model's."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class TableHeight(BodyEffect):
    """A surface, or a contact margin, that is higher or lower than the model's."""

    name = "table_height"
    title = "a wrong height of the surface"
    hook = "contact"
    parameters = (Parameter("height", "m", -1.0, 1.0, 0.001, True, "by which the surface is higher"),)
    figures: ClassVar = {"height": "height"}
    sizes = (1.0, 4.0, 16.0)
    signature = "constant error of the height at rest; touches too early or late"
    confused_with = ("object_size", "tracking_scale", "tracking_offset")
    tell_apart = "lay a thin body beside it; measure rest heights of two bodies of different size"
