"""Torque ripple of motor and gear, such as cogging or the ripple of harmonic drives."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class Ripple(FigureEffect):
    """Torque ripple of motor and gear, such as cogging or the ripple of harmonic drives."""

    name = "ripple"
    title = "torque ripple"
    hook = "actuator"
    parameters = (
        Parameter("sine", "N m", -20.0, 20.0, 0.1, True, "sine part over the joint's angle"),
        Parameter("cosine", "N m", -20.0, 20.0, 0.1, True, "cosine part"),
        Parameter("waves", "", 2.0, 40.0, 8.0, False, "per turn", per_angle=True),
    )
    figures = {"sine": "ripple_sine", "cosine": "ripple_cosine", "waves": "ripple_waves"}  # noqa: RUF012
    blends = False
    sizes = (1.0,)
    alone = True
    signature = "effort periodic in the angle"
    confused_with = ("eccentricity",)
    tell_apart = "slow constant speed: an eccentric encoder leaves the effort alone"

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return sets with each of several wave numbers, since a fit cannot move from one wave number to the next."""
        waves = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 16.0)
        parts = ((0.1, 0.0), (0.0, 0.1))
        return tuple({"sine": a, "cosine": b, "waves": k} for k in waves for a, b in parts)
