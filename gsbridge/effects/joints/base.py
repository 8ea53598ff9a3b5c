"""What effects of driven joints have in common, and the interface through which they change a simulated mechanism."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar, Protocol

from gsbridge.effects.base import Effect, Parameter
from gsbridge.geometry import Array

__all__ = ["ALL", "DRIVEN", "HOOKS", "FigureEffect", "JointEffect", "MechanismSetup", "Parameter"]

HOOKS = ("command", "actuator", "transmission", "body", "sensor", "clock")
"""Places where an effect takes hold, on the way from the command to the log."""

DRIVEN = ("torque", "pd", "position")
ALL = ("torque", "pd", "position", "free")


class MechanismSetup(Protocol):
    """A mechanism before it is simulated, as effects change it.

    Attributes:
        joints: Names of the mechanism's joints.
        law: Figures of the joints, by their names in `gsbridge.gap.joints.mechanism.joint_kernel.LAW`. Each [N].
        gravity: Gravity as it acts, base frame, m/s2; the controller believes in the nominal one. [3].
    """

    joints: tuple[str, ...]
    law: dict[str, Array]
    gravity: Array

    def delay_commands(self, seconds: float) -> None:
        """Let commands reach the controller some time later."""

    def smooth_commands(self, seconds: float) -> None:
        """Put a filter of first order before the controller; `seconds` is its time constant."""

    def limit_commands(self, joint: int, slowness: float) -> None:
        """Limit how fast the command of one joint may change; `slowness` is one over the largest speed, s/rad."""

    def scale_link(self, joint: int, factor: float) -> None:
        """Multiply mass and inertia of the link that a joint moves."""

    def add_payload(self, mass: float, place: Array) -> None:
        """Fix a point mass (kg) at a place (m) in the frame of the last link. [3]."""

    def lay_surface(self, height: float, stiffness: float) -> None:
        """Stop the tool, or the last link's end, at a height (m) above the base's origin; force per depth in N/m."""

    def restamp_motion(self, taken: Callable[[Array], Array]) -> None:
        """Log positions and speeds as they were at other times than their stamps say: stamps to times, s. [T] -> [T]."""


class JointEffect(Effect):
    """One thing that the simulation of a mechanism may lack.

    Attributes:
        modes: Ways of driving a mechanism under which it can show.
        blends: Whether adding signatures of different shape parameters gives those in between.
        threshold: Whether nothing shows below some size, so that signatures do not simply grow with it.
        fixed: Whether `sizes` are multiples of the typical size, not of the size that just stands out.
        cost: `sim` if it needs a simulation of its own, `post` if it changes logs only.
        turns: Whether it needs a joint that turns, and has no meaning at one that slides.
        sticks: Whether it can hold a joint at rest, where its law leaves open at which of many places.
        cuts: What it cuts off at one over its only parameter, `effort` or `command_velocity`; empty if it is no such limit.
    """

    scope: ClassVar[str] = "joint"
    modes: ClassVar[tuple[str, ...]] = ALL
    blends: ClassVar[bool] = True
    threshold: ClassVar[bool] = False
    fixed: ClassVar[bool] = False
    sizes: ClassVar[tuple[float, ...]] = (1.0, 6.0, 40.0)
    cost: ClassVar[str] = "sim"
    turns: ClassVar[bool] = False
    sticks: ClassVar[bool] = False
    cuts: ClassVar[str] = ""

    @abstractmethod
    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Put the effect into a setup, which is changed.

        Args:
            setup: The mechanism before it is simulated.
            joint: Column of the joint in the records; -1 for an effect of the whole mechanism.
            values: Value of every parameter by its name, in the unit that `parameters` states.
        """


class FigureEffect(JointEffect):
    """An effect that adds to figures of the joint's law, one parameter per figure.

    Attributes:
        figures: Name of each parameter's figure in `MechanismSetup.law`.
    """

    figures: ClassVar[Mapping[str, str]]

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Add every parameter to its figure; shapes replace it."""
        for parameter in self.parameters:
            row = setup.law[self.figures[parameter.name]]
            row[joint] = values[parameter.name] + (row[joint] if parameter.amplitude else 0.0)
