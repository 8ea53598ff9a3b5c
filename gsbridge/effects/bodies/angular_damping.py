"""Loss of spin in the air, or a damping that an engine adds: a spin s decays by s' = -d s, d being the coefficient."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class AngularDamping(BodyEffect):
    """Loss of spin in the air, or a damping that an engine adds: a spin s decays by s' = -d s, d being the coefficient."""

    name = "angular_damping"
    title = "damping of the spin"
    hook = "body"
    parameters = (Parameter("coefficient", "1/s", -10.0, 10.0, 0.04, True, "rate at which the spin decays, beyond the model"),)
    figures: ClassVar = {"coefficient": "angular_damping"}
    sizes = (1.0, 4.0, 16.0)
    signature = "spins down in flight already"
    confused_with = ("spinning_friction", "inertia_scale")
    tell_apart = "throw it with much spin; set the engine's own damping to zero"
