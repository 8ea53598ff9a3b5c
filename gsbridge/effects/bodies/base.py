"""The base class of effects on a free body, and the interface through which they change its simulation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Protocol

from gsbridge.effects.base import Effect, Parameter

__all__ = ["BodyEffect", "BodyFigures", "Parameter"]


class BodyFigures(Protocol):
    """Parameters of a body, its contact and its tracking before it is simulated, as effects change them."""

    def add(self, figure: str, change: float) -> None:
        """Add a change to a parameter, within the parameter's bounds."""

    def multiply(self, figure: str, change: float) -> None:
        """Multiply a parameter by one plus a change, within the parameter's bounds."""


class BodyEffect(Effect):
    """An effect whose parameters each change one simulation parameter of a free body.

    Attributes:
        figures: Name of the simulation parameter in `gsbridge.gap.contact.setup.BOUNDS` for each parameter of the effect.
        relative: Whether the effect's parameters are shares of the nominal values; otherwise they are added to them.
        needs_speeds: Whether the effect can be observed only if start speeds are logged.
    """

    scope: ClassVar[str] = "body"
    sizes: ClassVar[tuple[float, ...]] = (1.0, 3.0, 9.0)
    figures: ClassVar[Mapping[str, str]]
    relative: ClassVar[bool] = False
    needs_speeds: ClassVar[bool] = False

    def apply(self, setup: BodyFigures, values: Mapping[str, float]) -> None:
        """Change the simulation parameters of a setup in place; `values` holds one value per parameter of the effect."""
        for parameter in self.parameters:
            change = setup.multiply if self.relative else setup.add
            change(self.figures[parameter.name], values[parameter.name])

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return one parameter set per amplitude and sign within its bounds; shape parameters have their typical values."""
        rest = {p.name: 0.0 if p.amplitude else p.typical for p in self.parameters}
        out = []
        for parameter in self.parameters:
            if parameter.amplitude:
                for sign in (1.0, -1.0):
                    value = sign * parameter.typical
                    if parameter.low <= value <= parameter.high:
                        out.append(rest | {parameter.name: value})
        return tuple(out)
