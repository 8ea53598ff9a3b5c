"""A damping that differs from the stated one by the same share in the controllers of all joints."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class Damping(JointEffect):
    """A damping that is wrong by the same share in the controllers of all joints, as servos of one kind have the same error."""

    name = "damping"
    title = "another damping of all joints' controllers"
    hook = "actuator"
    scope = "mechanism"
    parameters = (Parameter("change", "", -0.8, 6.0, 0.1, True, "share by which the damping is larger"),)
    modes = ("pd",)
    signature = "all joints lag behind fast commands, and swing less after steps"
    confused_with = ("lag", "command_delay", "gain_d")
    tell_apart = "steps: a lag leaves the swing after them as it is"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Scale the damping of all joints' controllers."""
        setup.law["damping"] *= 1.0 + values["change"]
