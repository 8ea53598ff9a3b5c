"""A first-order lag of the drive's torque."""

from gsbridge.effects.joints.base import DRIVEN, FigureEffect, Parameter


class TorqueLag(FigureEffect):
    """A first-order lag of the drive's torque."""

    name = "torque_lag"
    title = "a slow drive"
    hook = "actuator"
    parameters = (Parameter("time", "s", 0.0, 0.05, 0.002, True, "time constant from asked to real torque"),)
    modes = DRIVEN
    figures = {"time": "torque_lag"}  # noqa: RUF012
    signature = "ringing after steps"
    confused_with = ("torque_delay", "lag", "gain_d")
    tell_apart = "square wave"
