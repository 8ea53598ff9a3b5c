"""Coulomb friction."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class Coulomb(FigureEffect):
    """Coulomb friction."""

    name = "coulomb"
    title = "Coulomb friction"
    hook = "transmission"
    parameters = (Parameter("torque", "N m", 0.0, 50.0, 0.1, True, "dry friction in both directions"),)
    figures = {"torque": "coulomb"}  # noqa: RUF012
    sticks = True
    signature = "effort changes by a step where the speed changes its sign; positions stick"
    confused_with = ("viscous", "stribeck", "backlash")
    tell_apart = "compare slow with fast constant speed"
