"""A shifted zero of the encoder."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class EncoderOffset(FigureEffect):
    """A shifted zero of the encoder."""

    name = "encoder_offset"
    title = "a shifted zero of the encoder"
    hook = "sensor"
    parameters = (Parameter("angle", "rad", -0.3, 0.3, 0.01, True, "added to the measured angle"),)
    figures = {"angle": "encoder_offset"}  # noqa: RUF012
    signature = "constant in position, weight at the wrong angle"
    confused_with = ("base_tilt", "effort_offset")
    tell_apart = "measure the tool from outside in several poses"
