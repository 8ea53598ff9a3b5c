"""Parameters ("figures") of one simulation of a free body: body, contact, surface and tracking; effects change them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.registry import Applied, effect_of
from gsbridge.gap.contact.body import FreeBody

BOUNDS: Mapping[str, tuple[float, float]] = {
    "friction": (0.0, 5.0),
    "restitution": (0.0, 1.0),
    "rolling_friction": (0.0, 1.0),
    "spinning_friction": (0.0, 1.0),
    "compliance": (0.0, 1.0),
    "contact_damping": (0.0, 1e6),
    "mass": (1e-6, 1e6),
    "com_x": (-10.0, 10.0),
    "com_y": (-10.0, 10.0),
    "com_z": (-10.0, 10.0),
    "inertia": (0.05, 20.0),
    "size": (0.2, 5.0),
    "height": (-100.0, 100.0),
    "tilt_x": (-1.0, 1.0),
    "tilt_y": (-1.0, 1.0),
    "linear_damping": (0.0, 100.0),
    "angular_damping": (0.0, 100.0),
    "gravity": (0.0, 100.0),
    "force_x": (-1e3, 1e3),
    "force_y": (-1e3, 1e3),
    "scale": (0.2, 5.0),
    "rate": (0.2, 5.0),
    "lag": (-1.0, 1.0),
    "offset_x": (-1.0, 1.0),
    "offset_y": (-1.0, 1.0),
    "offset_z": (-1.0, 1.0),
}
"""Figures and their bounds.

Contact: friction of the pair, restitution, rolling and spinning friction in m, compliance in m/N, its damping in N s/m. Body:
mass in kg, centre of mass in m, factors on inertia and size. Surface: height in m, tilt in rad about x and y. Losses
`v' = -d v` in 1/s, gravity in m/s2, a steady force in N. Tracking: factors on its lengths and on its clock, lag of its start
speeds in s, and the tracked point in the body frame in m."""


@dataclass
class BodySetup:
    """Figures of one simulation; a `gsbridge.effects.bodies.base.BodyFigures`.

    Args:
        figures: Figures of the body and its contact, by the names of `BOUNDS`.
    """

    figures: dict[str, float]

    @classmethod
    def nominal(cls, body: FreeBody) -> BodySetup:
        """Return the setup of a body without effects."""
        own = {"mass": body.mass, "com_x": float(body.com[0]), "com_y": float(body.com[1]), "com_z": float(body.com[2])}
        ones = dict.fromkeys(("inertia", "size", "scale", "rate"), 1.0)
        return cls(dict.fromkeys(BOUNDS, 0.0) | ones | own | dict(body.figures))

    def add(self, figure: str, change: float) -> None:
        """Add `change` to a figure, and clip the result to the figure's bounds."""
        self._put(figure, self.figures[figure] + change)

    def multiply(self, figure: str, change: float) -> None:
        """Multiply a figure by `1 + change`, and clip the result to the figure's bounds."""
        self._put(figure, self.figures[figure] * (1.0 + change))

    def _put(self, figure: str, value: float) -> None:
        low, high = BOUNDS[figure]
        self.figures[figure] = float(np.clip(value, low, high))


def body_setup(body: FreeBody, effects: Sequence[Applied] = ()) -> BodySetup:
    """Return the setup of a body with its own effects and further ones.

    Raises:
        InputError: An effect is unknown, is not an effect of a body, or its parameters are incomplete.
    """
    setup = BodySetup.nominal(body)
    for applied in (*body.effects, *effects):
        effect_of(applied, BODY_EFFECTS, source=body.source).apply(setup, applied.parameters)
    return setup
