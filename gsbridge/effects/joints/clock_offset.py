"""Measured motion that is stamped too late or too early."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class ClockOffset(JointEffect):
    """Positions and speeds that are stamped too late; efforts are stamped correctly, since another device logs them."""

    name = "clock_offset"
    title = "a clock offset of the measured motion"
    hook = "clock"
    scope = "mechanism"
    parameters = (Parameter("time", "s", -0.1, 0.1, 0.005, True, "by which motion is stamped too late"),)
    sizes = (1.0, 6.0, 40.0, 250.0, 1000.0, 2500.0, 5000.0)  # microseconds may show, yet the true time may be 0.25 s
    signature = "position error follows the speed; effort is right"
    confused_with = ("command_delay", "lag")
    tell_apart = "compare with the command's echo; efforts tell"
    reason = "it lies in the log, not in the arm"
    instead = "Correct the time stamps in the log, or synchronise the clocks; no policy needs to learn it"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Shift the logged motion in time."""
        setup.restamp_motion(lambda time: time - values["time"])
