"""Logged start speeds that belong to an earlier time, as those from backward differences do."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class TrackingLag(BodyEffect):
    """Logged start speeds that belong to an earlier time, as those from backward differences do."""

    name = "tracking_lag"
    title = "late start speeds"
    hook = "clock"
    parameters = (Parameter("time", "s", -0.03, 0.03, 0.003, True, "by which logged speeds are late"),)
    figures: ClassVar = {"time": "lag"}
    needs_speeds = True
    sizes = (1.0, 4.0)
    signature = "an error that grows in flight from the start, in the direction of the acceleration"
    confused_with = ("gravity_scale", "tracking_scale")
    tell_apart = "leave the speeds out: they are then taken from the poses"
    reason = "it lies in the tracking, not in the body"
    instead = "Leave the speeds out of the log; no policy needs to learn it"
