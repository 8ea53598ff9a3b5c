"""Drag that grows with the square of the speed."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class QuadraticDrag(FigureEffect):
    """Drag that grows with the square of the speed."""

    name = "quadratic_drag"
    title = "quadratic drag"
    hook = "transmission"
    parameters = (Parameter("coefficient", "N m s2/rad2", 0.0, 50.0, 0.05, True, "torque lost per squared speed"),)
    figures = {"coefficient": "quadratic"}  # noqa: RUF012
    signature = "effort grows with the square of the speed"
    confused_with = ("viscous",)
    tell_apart = "let large and small swings decay"
