"""Damping of the spin by air or by the engine: a spin s decays by s' = -d s, where d is the coefficient."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class AngularDamping(BodyEffect):
    """Damping of the spin by air or by the engine: a spin s decays by s' = -d s, where d is the coefficient."""

    name = "angular_damping"
    title = "damping of the spin"
    hook = "body"
    parameters = (Parameter("coefficient", "1/s", -10.0, 10.0, 0.04, True, "rate at which the spin decays, beyond the model"),)
    figures: ClassVar = {"coefficient": "angular_damping"}
    sizes = (1.0, 4.0, 16.0)
    signature = "spins down in flight already"
    confused_with = ("spinning_friction", "inertia_scale")
    tell_apart = "throw it with much spin; set the engine's own damping to zero"
