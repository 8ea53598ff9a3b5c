"""Stribeck friction."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class Stribeck(FigureEffect):
    """Stribeck friction."""

    name = "stribeck"
    title = "Stribeck friction"
    hook = "transmission"
    parameters = (
        Parameter("torque", "N m", 0.0, 30.0, 0.1, True, "more dry friction at rest than in motion"),
        Parameter("speed", "rad/s", 0.005, 0.5, 0.05, False, "speed at which it has fallen to 1/e"),
    )
    figures = {"torque": "stribeck", "speed": "stribeck_speed"}  # noqa: RUF012
    sticks = True
    alone = True
    signature = "a bump of effort near zero speed only"
    confused_with = ("backlash", "coulomb")
    tell_apart = "a very slow sine"
