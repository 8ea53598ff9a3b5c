"""The base class of all effects, whatever they act on, and of their parameters."""

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
        unit: SI unit.
        low: Smallest plausible value.
        high: Largest plausible value.
        typical: Typical size, from which a search starts.
        amplitude: True for an amplitude: the effect vanishes when all its amplitudes are zero. False for a shape parameter.
        meaning: Meaning of the parameter, in words.
        per_angle: Whether the parameter counts per turn of a joint, although its unit does not say so.
        grain: Smallest step in which a search resolves a shape parameter; zero stands for a tenth of its range.
        weighted_by: Name of the amplitude that multiplies this parameter, as a payload acts through mass times position; empty
            if the parameter acts by itself.
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
        hook: Stage at which it acts, on the way from the command to the log or from the scene to the file.
        scope: What it acts on: `joint` (one joint), `mechanism` (all joints at once), `body` or `camera`.
        parameters: Parameters of the effect; with all amplitudes at zero there is no effect.
        signature: How the effect looks in the residual between measurement and simulation.
        confused_with: Names of effects whose signatures look alike.
        tell_apart: The experiment that separates this effect from those.
        contains: Names of effects that are special cases of this one, with some of its amplitudes at zero.
        sizes: Multiples of the typical size, or of the smallest size above the noise, at which signatures are simulated.
        alone: Whether a model may hold the effect only once on the same thing, since two shapes do not add up to one.
        reason: Why the simulation cannot reproduce the effect, so that a model file cannot hold it; empty where it can.
        instead: What a user can do if the simulation cannot reproduce the effect.
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
    alone: ClassVar[bool] = False
    reason: ClassVar[str] = ""
    instead: ClassVar[str] = ""

    @property
    def amendable(self) -> bool:
        """Whether the simulation can reproduce the effect, so that a model file may hold it."""
        return not self.reason

    @property
    def advice(self) -> str | None:
        """Advice to the user if the simulation cannot reproduce the effect; None if it can."""
        return (
            None if self.amendable else f"A policy cannot learn with this in simulation, since {self.reason}. {self.instead}."
        )

    def called(self, parameter: str) -> str:
        """Return a parameter's name as used in sentences."""
        return parameter

    def directions(self) -> tuple[dict[str, float], ...]:
        """Return the parameter sets of typical size from which a search starts, with both signs where the bounds allow both."""
        out = []
        for sign in (1.0, -1.0):
            values = {p.name: sign * p.typical if p.amplitude else p.typical for p in self.parameters}
            if all(p.low <= values[p.name] <= p.high for p in self.parameters):
                out.append(values)
        return tuple(out)

    def scaled(self, values: Mapping[str, float], factor: float) -> dict[str, float]:
        """Multiply the amplitudes by a factor, keep the shape parameters, and clip all to their bounds."""
        return {p.name: min(max(values[p.name] * (factor if p.amplitude else 1.0), p.low), p.high) for p in self.parameters}
