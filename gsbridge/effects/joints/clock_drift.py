"""A clock of the measured motion that runs too fast or too slow."""

from collections.abc import Mapping

from gsbridge.effects.joints.base import JointEffect, MechanismSetup, Parameter


class ClockDrift(JointEffect):
    """Time stamps of positions and speeds that drift against those of commands and efforts, which another device logs."""

    name = "clock_drift"
    title = "a clock drift of the measured motion"
    hook = "clock"
    scope = "mechanism"
    parameters = (Parameter("drift", "1", -0.05, 0.05, 0.001, True, "seconds per second by which motion is stamped too late"),)
    sizes = (1.0, 6.0, 40.0)
    signature = "position error follows the speed and grows with time; effort is right"
    confused_with = ("clock_offset", "command_delay", "warming")
    tell_apart = "log for longer: an offset stays, a drift grows"
    reason = "it lies in the log, not in the arm"
    instead = "Correct the time stamps in the log, or synchronise the clocks; no policy needs to learn it"

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Stretch the logged motion in time."""
        setup.restamp_motion(lambda time: time * (1.0 - values["drift"]))
