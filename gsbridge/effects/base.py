"""What an effect is. Each lives in one file of this package; `catalogue` finds it there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from gsbridge.effects.parameter import Parameter
from gsbridge.gap.joints.mechanism.setup import JointSetup

__all__ = ["ALL", "DRIVEN", "HOOKS", "Effect", "FigureEffect", "Parameter"]

HOOKS = ("command", "actuator", "transmission", "body", "contact", "sensor", "clock", "image")
"""Places where an effect takes hold, on the way from the command to the log."""

DRIVEN = ("torque", "pd", "position")
ALL = ("torque", "pd", "position", "free")


class Effect(ABC):
    """One thing that a simulation may lack.

    Attributes:
        name: In files and reports.
        title: In sentences.
        hook: One of `HOOKS`.
        scope: `joint` (one joint), `mechanism` (all at once) or `body` (a thrown body).
        parameters: With all amplitudes at zero there is no effect.
        modes: Ways of driving a mechanism under which it can show.
        signature: How it looks in residuals.
        confused_with: Effects that look alike.
        tell_apart: The experiment that separates them.
        contains: Effects that are this one with some amplitudes at zero.
        blends: Whether adding signatures of different shape parameters gives those in between.
        threshold: Whether nothing shows below some size, so that signatures do not simply grow with it.
        sizes: Multiples of the size that just stands out, at which signatures are made; one suffices where they only grow.
        cost: `sim` if it needs a simulation of its own, `post` if it changes logs only.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    hook: ClassVar[str]
    scope: ClassVar[str] = "joint"
    parameters: ClassVar[tuple[Parameter, ...]]
    modes: ClassVar[tuple[str, ...]] = ALL
    signature: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]]
    tell_apart: ClassVar[str]
    contains: ClassVar[tuple[str, ...]] = ()
    blends: ClassVar[bool] = True
    threshold: ClassVar[bool] = False
    sizes: ClassVar[tuple[float, ...]] = (1.0, 6.0, 40.0)
    cost: ClassVar[str] = "sim"

    @abstractmethod
    def apply(self, setup: JointSetup, joint: int, values: Mapping[str, float]) -> None:
        """Put the effect into a setup. `joint` is a column of the records, -1 for a whole mechanism."""

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


class FigureEffect(Effect):
    """An effect that adds to figures of the joint's law, one parameter per figure.

    Attributes:
        figures: Name of each parameter's figure in `gsbridge.gap.joints.mechanism.joint_kernel.LAW`.
    """

    figures: ClassVar[Mapping[str, str]]

    def apply(self, setup: JointSetup, joint: int, values: Mapping[str, float]) -> None:
        """Add every parameter to its figure; shapes replace it."""
        for parameter in self.parameters:
            row = setup.law[self.figures[parameter.name]]
            row[joint] = values[parameter.name] + (row[joint] if parameter.amplitude else 0.0)
