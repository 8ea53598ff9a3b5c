"""A wrong scale factor of the torque."""

from gsbridge.effects.joints.base import DRIVEN, FigureEffect, Parameter


class TorqueGain(FigureEffect):
    """A wrong scale factor of the torque."""

    name = "torque_gain"
    title = "wrong scale of the torque"
    hook = "actuator"
    parameters = (Parameter("change", "", -0.6, 1.0, 0.1, True, "torque at the joint per torque logged, less one"),)
    modes = DRIVEN
    figures = {"change": "torque_gain"}  # noqa: RUF012
    signature = "all terms of the effort scaled alike"
    confused_with = ("payload", "link_mass", "gain_p")
    tell_apart = "hold a known load in static poses"
