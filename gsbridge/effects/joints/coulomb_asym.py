"""Coulomb friction that differs between directions."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class CoulombAsym(FigureEffect):
    """Coulomb friction that differs between directions."""

    name = "coulomb_asym"
    title = "Coulomb friction that differs between directions"
    hook = "transmission"
    parameters = (
        Parameter("torque", "N m", 0.0, 50.0, 0.1, True, "mean dry friction"),
        Parameter("skew", "N m", -20.0, 20.0, 0.05, True, "more forwards, less backwards"),
    )
    figures = {"torque": "coulomb", "skew": "coulomb_skew"}  # noqa: RUF012
    sticks = True
    signature = "steps of different height at the two reversals"
    confused_with = ("coulomb", "effort_offset")
    tell_apart = "hold at rest and ramp the torque slowly both ways"
    contains = ("coulomb",)

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return two sets of typical size: more friction forwards, and more friction backwards."""
        return tuple({"torque": 0.1, "skew": skew} for skew in (0.05, -0.05))
