"""An encoder disc whose centre is off its axis."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class Eccentricity(FigureEffect):
    """An encoder disc whose centre is off its axis."""

    name = "eccentricity"
    title = "an eccentric encoder"
    hook = "sensor"
    parameters = (
        Parameter("sine", "rad", -0.1, 0.1, 0.003, True, "sine part over the angle"),
        Parameter("cosine", "rad", -0.1, 0.1, 0.003, True, "cosine part"),
    )
    figures = {"sine": "eccentric_sine", "cosine": "eccentric_cosine"}  # noqa: RUF012
    sizes = (1.0,)
    turns = True
    signature = "position error once per turn"
    confused_with = ("encoder_scale", "encoder_offset", "ripple")
    tell_apart = "turn far; the effort hardly shows it"

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return the sine and the cosine part alone at typical size, with both signs."""
        return tuple({"sine": a, "cosine": b} for a, b in ((0.003, 0), (-0.003, 0), (0, 0.003), (0, -0.003)))
