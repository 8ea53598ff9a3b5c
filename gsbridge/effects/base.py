"""What an effect is, whatever it changes."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    Args:
        name: Name in model files.
        unit: Unit, SI.
        low: Smallest value that makes sense.
        high: Largest.
        typical: A size at which to begin looking.
        amplitude: Whether the effect vanishes as this goes to zero with the other amplitudes; others are shapes.
        meaning: What it means, in words.
        per_angle: Whether it counts per turn of a joint, though its unit does not say so.
        grain: Smallest scale on which a shape is looked at; zero for a tenth of its range.
        weighted_by: The amplitude whose product with this one acts, as a mass at a place does; empty for what acts by itself.
    """

    name: str
    unit: str
    low: float
    high: float
    typical: float
    amplitude: bool
    meaning: str
    per_angle: bool = False
    grain: float = 0.0
    weighted_by: str = ""


class Effect(ABC):
    """One thing that a simulation may lack.

    Attributes:
        name: Name in files and reports.
        title: Name in sentences.
        hook: Where it takes hold, on the way from the command to the log or from the scene to the file.
        scope: What it acts on: `joint` (one joint), `mechanism` (all joints at once), `body` or `camera`.
        parameters: Parameters of the effect; with all amplitudes at zero there is no effect.
        signature: How it looks in what is left between measurement and simulation.
        confused_with: Effects that look alike.
        tell_apart: The experiment that separates them.
        contains: Effects that are this one with some amplitudes at zero.
        sizes: Multiples of the typical size, or of the size that just stands out, at which signatures are made.
        reason: Why the simulation cannot play it, so that its model cannot hold it; empty where it can.
        instead: What to do about it then.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    hook: ClassVar[str]
    scope: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    signature: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]]
    tell_apart: ClassVar[str]
    contains: ClassVar[tuple[str, ...]] = ()
    sizes: ClassVar[tuple[float, ...]] = (1.0,)
    reason: ClassVar[str] = ""
    instead: ClassVar[str] = ""

    @property
    def amendable(self) -> bool:
        """Whether the simulation can play the effect, so that its model may hold it."""
        return not self.reason

    @property
    def advice(self) -> str | None:
        """Sentence on what a user can do where the simulation cannot play the effect; None where it can."""
        return (
            None if self.amendable else f"A policy cannot learn with this in simulation, since {self.reason}. {self.instead}."
        )

    def called(self, parameter: str) -> str:
        """A parameter's name in sentences."""
        return parameter

    def directions(self) -> tuple[dict[str, float], ...]:
        """Parameter sets of typical size whose multiples are looked at first; both signs where both make sense."""
        out = []
        for sign in (1.0, -1.0):
            values = {p.name: sign * p.typical if p.amplitude else p.typical for p in self.parameters}
            if all(p.low <= values[p.name] <= p.high for p in self.parameters):
                out.append(values)
        return tuple(out)

    def scaled(self, values: Mapping[str, float], factor: float) -> dict[str, float]:
        """Amplitudes multiplied, shapes kept, all within their bounds."""
        return {p.name: min(max(values[p.name] * (factor if p.amplitude else 1.0), p.low), p.high) for p in self.parameters}
