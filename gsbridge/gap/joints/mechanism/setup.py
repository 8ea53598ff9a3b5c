"""What one simulation is made of: the nominal figures of a mechanism, which effects change before it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from gsbridge.gap.formats.records import TOOL
from gsbridge.gap.joints.mechanism.inertials import Inertial
from gsbridge.gap.joints.mechanism.joint_kernel import LAW
from gsbridge.gap.joints.mechanism.joint_steps import follow
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.geometry import Array

CommandFilter = Callable[[Array, float], Array]
"""Commands on the grid of the physics [K, N] and its step in s -> commands that reach the controller [K, N]."""

Output = Callable[[Array, dict[str, Array]], dict[str, Array]]
"""Times [K] in s and channels, each [K, N] -> channels as they are logged. [K, N]."""


@dataclass
class JointSetup:
    """A mechanism ready to be simulated; a `gsbridge.effects.joints.base.MechanismSetup`.

    Args:
        law: Figures of the joints, by their names in `gsbridge.gap.joints.mechanism.joint_kernel.LAW`. Each [N].
        gravity: Gravity as it acts, base frame, m/s2; the controller believes in the nominal one. [3].
        inertials: Mass properties of the links as they are; the controller believes in the nominal ones.
        child_of: Link that each joint moves.
        joints: Names of the joints.
        surface: Height over the base's origin (m) and stiffness (N/m) of what the tool presses on; none is infinitely low. [2].
        commands: Hooks on the way of the commands.
        outputs: Hooks on the way to the log.
    """

    law: dict[str, Array]
    gravity: Array
    inertials: dict[str, Inertial]
    child_of: dict[str, str]
    joints: tuple[str, ...]
    surface: Array = field(default_factory=lambda: np.array([-np.inf, 0.0]))
    commands: list[CommandFilter] = field(default_factory=list)
    outputs: list[Output] = field(default_factory=list)

    @classmethod
    def nominal(cls, system: MechanismModel, inertials: dict[str, Inertial], child_of: dict[str, str]) -> JointSetup:
        """Setup of a mechanism without effects.

        Args:
            system: Model of the mechanism.
            inertials: Mass properties of the links by name.
            child_of: Name of the link that each joint moves, by the joint's name.
        """
        c, count = system.controller, len(system.joints)
        law = {name: np.zeros(count) for name in LAW}
        law["stiffness"], law["damping"] = c.stiffness.copy(), c.damping.copy()
        law["gravity_share"], law["torque_limit"] = np.full(count, c.gravity_compensation), c.torque_limit.copy()
        law["viscous"], law["coulomb"], law["armature"] = system.viscous.copy(), system.coulomb.copy(), system.armature.copy()
        law["stribeck_speed"], law["ripple_waves"] = np.ones(count), np.ones(count)
        return cls(law, system.gravity.copy(), dict(inertials), dict(child_of), system.joints)

    def rows(self) -> Array:
        """Figures as the kernel takes them. [len(LAW), N]."""
        return np.stack([self.law[name] for name in LAW])

    def delay_commands(self, seconds: float) -> None:
        """Let commands reach the controller some time later."""
        self.commands.append(lambda commands, step: delayed(commands, seconds, step))

    def smooth_commands(self, seconds: float) -> None:
        """Put a filter of first order before the controller; `seconds` is its time constant."""
        self.commands.append(lambda commands, step: smoothed(commands, seconds, step))

    def limit_commands(self, joint: int, slowness: float) -> None:
        """Limit how fast the command of one joint may change; `slowness` is one over the largest speed, s/rad."""

        def limit(commands: Array, step: float) -> Array:
            out = commands.copy()
            out[:, joint] = follow(commands[:, joint].copy(), step / slowness)
            return out

        self.commands.append(limit)

    def scale_link(self, joint: int, factor: float) -> None:
        """Multiply mass and inertia of the link that a joint moves."""
        link = self.child_of[self.joints[joint]]
        self.inertials[link] = self.inertials[link].scaled(factor)

    def add_payload(self, mass: float, place: Array) -> None:
        """Fix a point mass (kg) at a place (m) in the frame of the last link. [3]."""
        link = self.child_of[self.joints[-1]]
        self.inertials[link] = self.inertials[link].with_point(mass, place)

    def lay_surface(self, height: float, stiffness: float) -> None:
        """Stop the tool, or the last link's end, at a height (m) above the base's origin; force per depth in N/m."""
        self.surface = np.array([height, stiffness])

    def restamp_motion(self, taken: Callable[[Array], Array]) -> None:
        """Log positions and speeds as they were at other times than their stamps say: stamps to times, s. [T] -> [T]."""

        def late(time: Array, channels: dict[str, Array]) -> dict[str, Array]:
            out = dict(channels)
            for kind in (kind for kind in ("position", "velocity", TOOL) if kind in channels):
                out[kind] = np.stack([np.interp(taken(time), time, column) for column in channels[kind].T], axis=1)
            return out

        self.outputs.append(late)


def delayed(values: Array, seconds: float, step: float) -> Array:
    """Commands some time later; before the first one, the first one holds.

    Args:
        values: Commands. [K, N].
        seconds: Delay, s.
        step: Time between the rows, s.

    Returns:
        Delayed commands. [K, N].
    """
    grid = np.arange(len(values)) * step
    return np.stack([np.interp(grid - seconds, grid, column) for column in values.T], axis=1)


def smoothed(values: Array, seconds: float, step: float) -> Array:
    """Commands behind a filter of first order that has settled at the first one; exact for lines between commands.

    Args:
        values: Commands. [K, N].
        seconds: Time constant of the filter, s.
        step: Time between the rows, s.

    Returns:
        Filtered commands. [K, N].
    """
    if seconds <= 0:
        return values
    keep = np.exp(-step / seconds)
    # Commands that were held for a step instead would come out half a step too early, which is a lag of its own.
    old = seconds / step * (1 - keep)
    return lfilter([1 - old, old - keep], [1, -keep], values, axis=0, zi=old * values[:1])[0]
