"""A dead time between command and controller."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import DRIVEN, JointEffect, MechanismSetup, Parameter


class CommandDelay(JointEffect):
    """A dead time between command and controller, equal for all joints."""

    name = "command_delay"
    title = "latency of the commands"
    hook = "command"
    scope = "mechanism"
    parameters = (Parameter("time", "s", 0.0, 0.4, 0.005, True, "from a command to the controller"),)
    modes = DRIVEN
    sizes = (1.0, 6.0, 40.0, 250.0, 1000.0, 2500.0, 5000.0)  # microseconds may show, yet the true time may be 0.25 s
    signature = "position error follows the speed; sharp at steps"
    confused_with = ("lag", "clock_offset")
    tell_apart = "a square wave; compare with the command's echo"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Delay the commands."""
        setup.delay_commands(values["time"])
