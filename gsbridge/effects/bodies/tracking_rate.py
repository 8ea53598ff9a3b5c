"""A clock of the log that runs too fast or too slow."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class TrackingRate(BodyEffect):
    """A clock of the log that runs too fast or too slow."""

    name = "tracking_rate"
    title = "a wrong rate of the log's clock"
    hook = "clock"
    parameters = (Parameter("share", "1", -0.5, 0.5, 0.01, True, "by which logged times are too long"),)
    figures: ClassVar = {"share": "rate"}
    relative = True
    sizes = (1.0, 4.0)
    signature = "all motion is too slow or fast; places are right"
    confused_with = ("gravity_scale",)
    tell_apart = "film a stop watch"
    reason = "it lies in the tracking, not in the body"
    instead = "Correct the times in the log; no policy needs to learn it"
