"""Free play in the transmission."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class Backlash(FigureEffect):
    """Free play in the transmission."""

    name = "backlash"
    title = "free play in the transmission"
    hook = "transmission"
    parameters = (
        Parameter("gap", "rad", 0.0, 0.1, 0.003, True, "free play between motor and joint; the encoder sits at the motor"),
    )
    modes = ("pd",)
    figures = {"gap": "backlash"}  # noqa: RUF012
    threshold = True
    sizes = (1.0, 2.0, 4.0, 8.0, 16.0)
    signature = "flat after each reversal, then a jump; effort dips"
    confused_with = ("compliance", "stribeck")
    tell_apart = "small reversals under two loads"
    reason = "the simulated motors are rigidly coupled to their joints"
    instead = "Have the gear tightened, or preload the joint so that its load never changes sign"
