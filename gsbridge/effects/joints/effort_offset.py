"""A constant torque that the log does not show."""

from gsbridge.effects.joints.base import DRIVEN, FigureEffect, Parameter


class EffortOffset(FigureEffect):
    """A constant torque that the log does not show."""

    name = "effort_offset"
    title = "a constant torque that the log does not show"
    hook = "actuator"
    parameters = (Parameter("torque", "N m", -20.0, 20.0, 0.1, True, "added at the joint"),)
    modes = DRIVEN
    figures = {"torque": "torque_offset"}  # noqa: RUF012
    sizes = (1.0, 10.0)
    signature = "constant error of effort, also at rest"
    confused_with = ("coulomb_asym", "base_tilt")
    tell_apart = "rest in many poses"
