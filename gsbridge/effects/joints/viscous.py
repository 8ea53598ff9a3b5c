"""Viscous friction."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class Viscous(FigureEffect):
    """Viscous friction."""

    name = "viscous"
    title = "viscous friction"
    hook = "transmission"
    parameters = (Parameter("coefficient", "N m s/rad", 0.0, 50.0, 0.1, True, "torque lost per speed"),)
    figures = {"coefficient": "viscous"}  # noqa: RUF012
    signature = "effort grows with speed, without a step at reversal"
    confused_with = ("gain_d", "coulomb", "quadratic_drag")
    tell_apart = "move at several constant speeds; log command and effort"
