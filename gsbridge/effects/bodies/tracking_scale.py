"""A wrong length scale of the log."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class TrackingScale(BodyEffect):
    """A wrong length scale of the log."""

    name = "tracking_scale"
    title = "a wrong length scale of the tracking"
    hook = "sensor"
    parameters = (Parameter("share", "1", -0.5, 0.5, 0.02, True, "by which logged lengths are too large"),)
    figures: ClassVar = {"share": "scale"}
    relative = True
    sizes = (1.0, 3.0)
    signature = "distances, heights at rest and gravity are off by the same share"
    confused_with = ("gravity_scale", "object_size", "tracking_lag")
    tell_apart = "log two markers at a known distance"
    reason = "it lies in the tracking, not in the body"
    instead = "Correct the lengths in the log; no policy needs to learn it"
