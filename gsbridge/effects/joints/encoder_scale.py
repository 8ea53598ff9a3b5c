"""A wrong scale factor of the encoder."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class EncoderScale(FigureEffect):
    """A wrong scale factor of the encoder."""

    name = "encoder_scale"
    title = "a wrong scale of the encoder"
    hook = "sensor"
    parameters = (Parameter("change", "", -0.2, 0.2, 0.01, True, "measured per true angle, less one"),)
    figures = {"change": "encoder_scale"}  # noqa: RUF012
    signature = "position error grows with the angle"
    confused_with = ("encoder_offset", "gain_p")
    tell_apart = "use the whole range of the joint"
