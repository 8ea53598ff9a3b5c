"""Grid of an effect: the sizes that are simulated first, in each of its directions."""

from __future__ import annotations

from gsbridge.effects.base import Parameter
from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.effects.bodies.base import BodyEffect
from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.body import FreeBody
from gsbridge.gap.contact.setup import BOUNDS, body_setup

_HALVINGS = (0.5, 0.75, 0.875, 1.0)
"""Shares by which a figure is reduced on its way to zero."""


def grid_ways(body: FreeBody, name: str) -> list[list[Applied]]:
    """Return the parameters at which an effect is tried first: one list per direction, in growing sizes.

    A figure that falls towards zero is halved instead of lowered in equal steps. Example: a ball rolls with any friction above
    a small one, so only the last eighth of the friction makes a visible difference.

    Args:
        body: The model whose figures the effect changes.
        name: Name of the effect.
    """
    effect = BODY_EFFECTS[name]
    return [_way(body, effect, direction) for direction in effect.directions()]


def _way(body: FreeBody, effect: BodyEffect, direction: dict[str, float]) -> list[Applied]:
    points = [Applied(effect.name, "", effect.scaled(direction, size)) for size in effect.sizes]
    moved = next(parameter for parameter in effect.parameters if parameter.amplitude and direction[parameter.name] != 0.0)
    nothing = vanishing(body, (), effect, moved)
    if nothing is None or direction[moved.name] > 0.0:
        return points
    near = [point for point in points if point.parameters[moved.name] > _HALVINGS[0] * nothing]
    return near + [Applied(effect.name, "", {**direction, moved.name: part * nothing}) for part in _HALVINGS]


def vanishing(body: FreeBody, others: tuple[Applied, ...], effect: BodyEffect, parameter: Parameter) -> float | None:
    """Return the value of a parameter that makes its figure zero; None if zero is not a bound, or the figure is zero already.

    Args:
        body: The model.
        others: Effects that are also present.
        effect: The effect.
        parameter: The parameter.
    """
    figure = effect.figures[parameter.name]
    now = body_setup(body, others).figures[figure]
    return -now if not effect.relative and BOUNDS[figure][0] == 0.0 and now > 0.0 else None
