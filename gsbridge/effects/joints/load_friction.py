"""Dry friction that grows with the torque on the joint."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class LoadFriction(FigureEffect):
    """Dry friction that grows with the torque on the joint."""

    name = "load_friction"
    title = "friction that grows with the load"
    hook = "transmission"
    parameters = (Parameter("share", "", 0.0, 1.0, 0.02, True, "dry friction per torque on the joint"),)
    figures = {"share": "load_friction"}  # noqa: RUF012
    sticks = True
    signature = "effort steps at reversals that grow with the torque"
    confused_with = ("coulomb", "torque_gain")
    tell_apart = "repeat with and without a payload"
