"""Inertia of rotor and gear."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class Armature(FigureEffect):
    """Inertia of rotor and gear."""

    name = "armature"
    title = "inertia of rotor and gear"
    hook = "actuator"
    parameters = (Parameter("inertia", "kg m2", 0.0, 5.0, 0.005, True, "seen from the joint"),)
    figures = {"inertia": "armature"}  # noqa: RUF012
    signature = "effort grows with the acceleration, at its own joint only"
    confused_with = ("link_mass", "payload")
    tell_apart = "other joints do not react to it; shake one joint at a time"
