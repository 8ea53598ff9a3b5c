"""A speed limit on the command of one joint."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class RateLimit(JointEffect):
    """A speed limit on the command of one joint."""

    name = "rate_limit"
    title = "a speed limit on the commands"
    hook = "command"
    parameters = (Parameter("slowness", "s/rad", 0.0, 50.0, 0.5, True, "one over the largest speed"),)
    modes = ("pd", "position")
    threshold = True
    cuts = "command_velocity"
    sizes = (1.0, 1.05, 1.12, 1.25, 1.5, 2.0)
    signature = "errors only while the command is faster than the limit"
    confused_with = ("saturation", "lag")
    tell_apart = "a smaller amplitude makes it vanish"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Limit the speed of the joint's command."""
        if values["slowness"] > 0:
            setup.limit_commands(joint, values["slowness"])
