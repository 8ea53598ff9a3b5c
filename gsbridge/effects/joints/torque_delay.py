"""A dead time of the drive."""

from gsbridge.effects.joints.base import DRIVEN, FigureEffect, Parameter


class TorqueDelay(FigureEffect):
    """A dead time of the drive."""

    name = "torque_delay"
    title = "dead time of the drive"
    hook = "actuator"
    parameters = (Parameter("time", "s", 0.0, 0.02, 0.001, True, "from asked to real torque, inside the control loop"),)
    modes = DRIVEN
    figures = {"time": "torque_delay"}  # noqa: RUF012
    signature = "ringing, then instability"
    confused_with = ("torque_lag", "gain_d")
    tell_apart = "square wave"
