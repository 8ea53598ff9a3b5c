"""A first-order filter between command and controller."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import DRIVEN, JointEffect, MechanismSetup, Parameter


class Lag(JointEffect):
    """A first-order filter between command and controller, equal for all joints."""

    name = "lag"
    title = "a filter on the commands"
    hook = "command"
    scope = "mechanism"
    parameters = (Parameter("time", "s", 0.0, 0.4, 0.005, True, "time constant"),)
    modes = DRIVEN
    sizes = (1.0, 6.0, 40.0, 250.0, 1000.0, 2500.0, 5000.0)  # microseconds may show, yet the true time may be 0.25 s
    signature = "smoothed response, rounded corners"
    confused_with = ("command_delay", "gain_d")
    tell_apart = "a square wave or a chirp of 2 to 10 Hz"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Filter the commands."""
        setup.smooth_commands(values["time"])
