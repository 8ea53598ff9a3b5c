"""A cable or spring that pulls."""

from gsbridge.effects.joints.base import FigureEffect, Parameter

_APART = 1.0
"""Distance between the rest angles at which signatures are simulated, rad; weighted sums of them give every rest angle."""


class Spring(FigureEffect):
    """A cable or spring that pulls."""

    name = "spring"
    title = "a cable or spring that pulls"
    hook = "transmission"
    parameters = (
        Parameter("stiffness", "N m/rad", 0.0, 50.0, 0.2, True, "torque per angle"),
        Parameter("rest", "rad", -3.0, 3.0, 0.0, False, "angle at which it pulls nothing", weighted_by="stiffness"),
    )
    figures = {"stiffness": "spring", "rest": "spring_rest"}  # noqa: RUF012
    signature = "effort grows with the angle, equal in both directions"
    confused_with = ("payload", "gravcomp", "encoder_scale")
    tell_apart = "unplug or re-route the cable"

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return springs with rest angles of zero and `_APART` on either side; an off-centre spring pulls mostly one way."""
        return tuple({"stiffness": 0.2, "rest": rest} for rest in (0.0, _APART, -_APART))
