"""A log that tracks a point of the body other than the model's origin."""

from typing import ClassVar

from gsbridge.effects.bodies.base import BodyEffect, Parameter


class TrackingOffset(BodyEffect):
    """A log that tracks a point of the body other than the model's origin."""

    name = "tracking_offset"
    title = "an offset of the tracked point"
    hook = "sensor"
    parameters = (
        Parameter("x", "m", -0.5, 0.5, 0.002, True, "of the tracked point along the body's own axis"),
        Parameter("y", "m", -0.5, 0.5, 0.002, True, "of the tracked point along the body's own axis"),
        Parameter("z", "m", -0.5, 0.5, 0.002, True, "of the tracked point along the body's own axis"),
    )
    figures: ClassVar = {"x": "offset_x", "y": "offset_y", "z": "offset_z"}
    sizes = (1.0, 4.0)
    signature = "circles that turn with the body"
    confused_with = ("object_com", "table_height")
    tell_apart = "turn it by hand in one place"
    reason = "it lies in the tracking, not in the body"
    instead = "Correct the tracked point in the log; no policy needs to learn it"
