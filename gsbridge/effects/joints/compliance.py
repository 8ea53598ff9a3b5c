"""An elastic transmission."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class Compliance(FigureEffect):
    """An elastic transmission."""

    name = "compliance"
    title = "an elastic transmission"
    hook = "transmission"
    parameters = (
        Parameter(
            "compliance",
            "rad/(N m)",
            0.0,
            0.02,
            0.0005,
            True,
            "twist between motor and joint per torque; the encoder sits at the motor",
        ),
    )
    modes = ("pd",)
    figures = {"compliance": "compliance"}  # noqa: RUF012
    signature = "position error follows the effort; a resonance"
    confused_with = ("backlash", "payload")
    tell_apart = "static poses with a load; a dead zone is none"
    reason = "the simulated motors are rigidly coupled to their joints"
    instead = "Lower the load or the acceleration, or measure the tool from outside and correct the commanded poses"
