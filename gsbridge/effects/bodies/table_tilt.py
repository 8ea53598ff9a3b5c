"""A surface that is not level."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class TableTilt(BodyEffect):
    """A surface that is not level."""

    name = "table_tilt"
    title = "a tilt of the surface"
    hook = "contact"
    parameters = (
        Parameter("about_x", "rad", -0.5, 0.5, 0.005, True, "turn of the surface"),
        Parameter("about_y", "rad", -0.5, 0.5, 0.005, True, "turn of the surface"),
    )
    figures: ClassVar = {"about_x": "tilt_x", "about_y": "tilt_y"}
    sizes = (1.0, 6.0)
    signature = "drifts to one side while it slides, rests at heights that depend on the place"
    confused_with = ("steady_force", "contact_friction")
    tell_apart = "slide it both ways along both axes; lay a spirit level"
