"""Friction that changes over time, such as while the arm warms up."""

from gsbridge.effects.joints.base import FigureEffect, Parameter


class Warming(FigureEffect):
    """Friction that changes over time, such as while the arm warms up."""

    name = "warming"
    title = "friction that changes while running"
    hook = "transmission"
    parameters = (Parameter("rate", "1/s", -0.1, 0.1, 0.01, True, "change of viscous and dry friction per second, share"),)
    figures = {"rate": "warming"}  # noqa: RUF012
    signature = "the residual changes over time"
    confused_with = ("viscous", "coulomb")
    tell_apart = "record again after a warm-up"
    reason = "every simulated episode begins anew, while this friction goes on changing from one to the next"
    instead = "Warm the arm up before work, log it again, and amend the friction that is then found"
