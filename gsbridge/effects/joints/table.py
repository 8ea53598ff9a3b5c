"""A surface in the way of the tool."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class Table(JointEffect):
    """A level surface that the end of the last link presses on: a table, the floor."""

    name = "table"
    title = "a table in the way"
    hook = "body"
    scope = "mechanism"
    parameters = (
        Parameter("stiffness", "N/m", 0.0, 1e6, 1000.0, True, "force per depth of the tool, or of the last link's end"),
        Parameter("height", "m", -3.0, 3.0, 0.0, False, "of the surface, vertically from the base's origin", grain=0.02),
    )
    modes = ("pd", "position")
    blends = False
    threshold = True
    fixed = True
    sizes = (2.0, 50.0)
    alone = True
    signature = "several joints at once fall short of their commands, in low postures only"
    confused_with = ("payload", "encoder_offset")
    tell_apart = "the same motion a hand's breadth higher"
    reason = "the simulated table stands where the registration has it"
    instead = "Register the table, or keep the commands above it"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Add the surface to the setup."""
        if values["stiffness"] > 0.0:
            setup.lay_surface(values["height"], values["stiffness"])
