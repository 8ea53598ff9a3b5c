"""A soft contact: a compliance in parallel with a damper."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class ContactSoftness(BodyEffect):
    """A soft contact: a compliance in parallel with a damper."""

    name = "contact_softness"
    title = "a soft contact"
    hook = "contact"
    parameters = (
        Parameter("compliance", "m/N", 0.0, 0.1, 0.0001, True, "by which the contact gives way"),
        Parameter("damping", "N s/m", 0.0, 10000.0, 10.0, False, "of the contact"),
    )
    figures: ClassVar = {"compliance": "compliance", "damping": "contact_damping"}
    sizes = (1.0, 4.0, 16.0)
    signature = "sinks in, and impacts last long"
    confused_with = ("restitution", "table_height")
    tell_apart = "film an impact at a high rate; press on it with a known weight"
