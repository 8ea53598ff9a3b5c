"""A gravity in the log that differs from the model's."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class GravityScale(BodyEffect):
    """A gravity in the log that differs from the model's."""

    name = "gravity_scale"
    title = "a wrong gravity"
    hook = "body"
    parameters = (Parameter("share", "1", -0.9, 1.0, 0.02, True, "by which it differs, of the model's"),)
    figures: ClassVar = {"share": "gravity"}
    relative = True
    sizes = (1.0, 4.0)
    signature = "falls too fast or slow; rests right"
    confused_with = ("tracking_rate", "tracking_scale", "tracking_lag")
    tell_apart = "drop it beside a scale and a stop watch"
