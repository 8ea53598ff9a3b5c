"""A constant horizontal force, such as the pull of a cable or wind."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class SteadyForce(BodyEffect):
    """A constant horizontal force, such as the pull of a cable or wind."""

    name = "steady_force"
    title = "a steady force"
    hook = "body"
    parameters = (
        Parameter("x", "N", -100.0, 100.0, 0.02, True, "along the log's axis"),
        Parameter("y", "N", -100.0, 100.0, 0.02, True, "along the log's axis"),
    )
    figures: ClassVar = {"x": "force_x", "y": "force_y"}
    sizes = (1.0, 8.0)
    signature = "drifts to one side in flight already"
    confused_with = ("table_tilt",)
    tell_apart = "throw it high; take the cable away"
