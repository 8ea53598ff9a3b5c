"""Damping of the speed by air or by the engine: a speed s decays by s' = -d s, where d is the coefficient."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class LinearDamping(BodyEffect):
    """Damping of the speed by air or by the engine: a speed s decays by s' = -d s, where d is the coefficient."""

    name = "linear_damping"
    title = "damping of the motion"
    hook = "body"
    parameters = (Parameter("coefficient", "1/s", -10.0, 10.0, 0.04, True, "rate at which the speed decays, beyond the model"),)
    figures: ClassVar = {"coefficient": "linear_damping"}
    sizes = (1.0, 4.0, 16.0)
    signature = "slows down in flight already"
    confused_with = ("gravity_scale", "tracking_rate")
    tell_apart = "throw it far and flat; set the engine's own damping to zero"
