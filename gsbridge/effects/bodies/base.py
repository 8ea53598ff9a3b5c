"""What effects of a free body have in common, and the interface through which they change a simulation of one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Protocol

from gsbridge.effects.base import Effect, Parameter

__all__ = ["BodyEffect", "BodyFigures", "Parameter"]


class BodyFigures(Protocol):
    """Figures of a body, its contact and its tracking before it is simulated, as effects change them."""

    def add(self, figure: str, change: float) -> None:
        """Change a figure, within its bounds."""

    def multiply(self, figure: str, change: float) -> None:
        """Change a figure by a share of itself, within its bounds."""


class BodyEffect(Effect):
    """An effect that changes figures of a free body, one parameter per figure.

    Attributes:
        figures: Name of each parameter's figure in `gsbridge.gap.contact.setup.BOUNDS`.
        relative: Whether parameters are shares of the nominal figures; otherwise they are added.
        needs_speeds: Whether it can only show where start speeds are logged.
    """

    scope: ClassVar[str] = "body"
    sizes: ClassVar[tuple[float, ...]] = (1.0, 3.0, 9.0)
    figures: ClassVar[Mapping[str, str]]
    relative: ClassVar[bool] = False
    needs_speeds: ClassVar[bool] = False

    def apply(self, setup: BodyFigures, values: Mapping[str, float]) -> None:
        """Change the figures."""
        for parameter in self.parameters:
            change = setup.multiply if self.relative else setup.add
            change(self.figures[parameter.name], values[parameter.name])

    def directions(self) -> tuple[dict[str, float], ...]:
        """One set of parameters per amplitude and per sign within its bounds; shape parameters have their typical values."""
        rest = {p.name: 0.0 if p.amplitude else p.typical for p in self.parameters}
        out = []
        for parameter in self.parameters:
            if parameter.amplitude:
                for sign in (1.0, -1.0):
                    value = sign * parameter.typical
                    if parameter.low <= value <= parameter.high:
                        out.append(rest | {parameter.name: value})
        return tuple(out)
