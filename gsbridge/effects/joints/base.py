"""The base classes of effects on driven joints, and the interface through which they change a simulated mechanism."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar, Protocol

from gsbridge.effects.base import Effect, Parameter
from gsbridge.geometry import Array

__all__ = ["ALL", "DRIVEN", "HOOKS", "FigureEffect", "JointEffect", "MechanismSetup", "Parameter"]

HOOKS = ("command", "actuator", "transmission", "body", "sensor", "clock")
"""Stages at which an effect can act, on the way from the command to the log."""

DRIVEN = ("torque", "pd", "position")
ALL = ("torque", "pd", "position", "free")


class MechanismSetup(Protocol):
    """A mechanism before it is simulated, as effects change it.

    Attributes:
        joints: Names of the mechanism's joints.
        law: Parameters of the joints, by their names in `gsbridge.gap.joints.mechanism.joint_kernel.LAW`. Each [N].
        gravity: True gravity in the base frame, m/s2; the controller uses the nominal one. [3].
    """

    joints: tuple[str, ...]
    law: dict[str, Array]
    gravity: Array

    def delay_commands(self, seconds: float) -> None:
        """Delay the commands to the controller by a time, s."""

    def smooth_commands(self, seconds: float) -> None:
        """Filter the commands with a first-order low-pass; `seconds` is its time constant."""

    def limit_commands(self, joint: int, slowness: float) -> None:
        """Limit the rate of one joint's command; `slowness` is one over the largest speed, s/rad."""

    def scale_link(self, joint: int, factor: float) -> None:
        """Multiply mass and inertia of the link that a joint moves by a factor."""

    def add_payload(self, mass: float, place: Array) -> None:
        """Fix a point mass (kg) at a position (m) in the frame of the last link. [3]."""

    def lay_surface(self, height: float, stiffness: float) -> None:
        """Place an elastic horizontal surface under the tool, or under the last link's end if there is no tool.

        Args:
            height: Height of the surface above the base's origin, m.
            stiffness: Contact force per depth of penetration, N/m.
        """

    def restamp_motion(self, taken: Callable[[Array], Array]) -> None:
        """Log positions and speeds with wrong time stamps; `taken` maps stamps to true times, s. [T] -> [T]."""


class JointEffect(Effect):
    """An effect that the simulation of a mechanism may lack.

    Attributes:
        modes: Drive modes in which the effect can be observed.
        blends: Whether sums of signatures with different shape parameters approximate the signatures of shapes in between.
        threshold: Whether the effect is invisible below some size, so that its signature is not proportional to its size.
        fixed: Whether `sizes` are multiples of the typical size, not of the smallest size above the noise.
        cost: `sim` if the effect needs a simulation of its own, `post` if it changes logs only.
        turns: Whether the effect exists at revolute joints only.
        sticks: Whether the effect can hold a joint at rest, where its law does not determine the position of rest.
        cuts: The quantity that the effect limits to one over its only parameter: `effort` or `command_velocity`; empty if it is
            no such limit.
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
        """Add the effect to a setup, which is changed in place.

        Args:
            setup: The mechanism before it is simulated.
            joint: Column of the joint in the records; -1 for an effect of the whole mechanism.
            values: Value of every parameter by its name, in the unit that `parameters` states.
        """


class FigureEffect(JointEffect):
    """An effect whose parameters each change one row of `MechanismSetup.law`.

    Attributes:
        figures: Name of the row in `MechanismSetup.law` for each parameter.
    """

    figures: ClassVar[Mapping[str, str]]

    def apply(self, setup: MechanismSetup, joint: int, values: Mapping[str, float]) -> None:
        """Add each amplitude to its row of the law; a shape parameter replaces the value there.

        A shape parameter that an amplitude weights becomes the weighted mean with the value there, as two springs make one.
        """
        # Shapes come first, while the amplitudes are still those of the earlier entries.
        for parameter in sorted(self.parameters, key=lambda parameter: parameter.amplitude):
            row, value = setup.law[self.figures[parameter.name]], values[parameter.name]
            weight = setup.law[self.figures[parameter.weighted_by]][joint] if parameter.weighted_by else 0.0
            if parameter.amplitude:
                row[joint] += value
            elif weight:
                own = values[parameter.weighted_by]
                row[joint] = (weight * row[joint] + own * value) / (weight + own)
            else:
                row[joint] = value
