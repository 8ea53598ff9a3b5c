"""The input of one simulation: the nominal figures of a mechanism, which effects change before it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from gsbridge.gap.joints.mechanism.inertials import Inertial
from gsbridge.gap.joints.mechanism.joint_kernel import LAW
from gsbridge.gap.joints.mechanism.joint_steps import follow
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.geometry import Array

CommandFilter = Callable[[Array, float, str], Array]
"""Function that turns commands on the grid of the physics [K, N], with its step in s and their kind (a key of
`gsbridge.gap.formats.records.COMMANDS`), into those that reach the controller."""

Clock = Callable[[Array], Array]
"""Function that turns time stamps into the times of the measurements, s. [T] -> [T]."""


@dataclass
class JointSetup:
    """A mechanism ready to be simulated; a `gsbridge.effects.joints.base.MechanismSetup`.

    Args:
        law: Figures of the joints, by their names in `gsbridge.gap.joints.mechanism.joint_kernel.LAW`. Each [N].
        gravity: Gravity as it acts, base frame, m/s2; the controller uses the nominal one. [3].
        inertials: Actual mass properties of the links; the controller uses the nominal ones.
        child_of: Name of the link that each joint moves, by the joint's name.
        joints: Names of the joints.
        last: Name of the link that the outermost joint moves; the order of `joints` does not tell, it is that of the records.
        surface: Height above the base's origin (m) and stiffness (N/m) of a surface below the tool; without one, the height is
            minus infinity. [2].
        commands: Functions that act on the commands before they reach the controller, in order.
        clocks: Clocks of the logged positions and speeds, in order.
    """

    law: dict[str, Array]
    gravity: Array
    inertials: dict[str, Inertial]
    child_of: dict[str, str]
    joints: tuple[str, ...]
    last: str
    surface: Array = field(default_factory=lambda: np.array([-np.inf, 0.0]))
    commands: list[CommandFilter] = field(default_factory=list)
    clocks: list[Clock] = field(default_factory=list)

    @classmethod
    def nominal(
        cls, system: MechanismModel, inertials: dict[str, Inertial], child_of: dict[str, str], outermost: str
    ) -> JointSetup:
        """Make the setup of a mechanism without effects.

        Args:
            system: Model of the mechanism.
            inertials: Mass properties of the links by name.
            child_of: Name of the link that each joint moves, by the joint's name.
            outermost: Name of the outermost joint.
        """
        c, count = system.controller, len(system.joints)
        law = {name: np.zeros(count) for name in LAW}
        # An observer is no controller: effects of the controller do not act on it.
        spring, damper = ("pull_stiffness", "pull_damping") if c.observes else ("stiffness", "damping")
        law[spring], law[damper] = c.stiffness.copy(), c.damping.copy()
        law["gravity_share"], law["torque_limit"] = np.full(count, c.gravity_compensation), c.torque_limit.copy()
        law["viscous"], law["coulomb"], law["armature"] = system.viscous.copy(), system.coulomb.copy(), system.armature.copy()
        law["stribeck_speed"], law["ripple_waves"] = np.ones(count), np.ones(count)
        return cls(law, system.gravity.copy(), dict(inertials), dict(child_of), system.joints, child_of[outermost])

    def rows(self) -> Array:
        """Stack the figures in the order of the kernel. [len(LAW), N]."""
        return np.stack([self.law[name] for name in LAW])

    def delay_commands(self, seconds: float) -> None:
        """Delay the commands on their way to the controller by a time in s."""
        self.commands.append(lambda commands, step, _: delayed(commands, seconds, step))

    def smooth_commands(self, seconds: float) -> None:
        """Put a filter of first order before the controller; `seconds` is its time constant, s."""
        self.commands.append(lambda commands, step, _: smoothed(commands, seconds, step))

    def limit_commands(self, joint: int, slowness: float) -> None:
        """Limit how fast the command of one joint may change; `slowness` is one over the largest speed, s/rad or s/m.

        Commanded speeds are cut off at the largest; torques are no motion and pass.
        """

        def limit(commands: Array, step: float, kind: str) -> Array:
            out = commands.copy()
            if kind == "command":
                out[:, joint] = follow(commands[:, joint].copy(), step / slowness)
            elif kind == "command_velocity":
                out[:, joint] = commands[:, joint].clip(-1.0 / slowness, 1.0 / slowness)
            return out

        self.commands.append(limit)

    def scale_link(self, joint: int, factor: float) -> None:
        """Multiply mass and inertia of the link that a joint moves."""
        link = self.child_of[self.joints[joint]]
        self.inertials[link] = self.inertials[link].scaled(factor)

    def add_payload(self, mass: float, place: Array) -> None:
        """Fix a point mass (kg) at a place in the frame of the last link (m, [3])."""
        self.inertials[self.last] = self.inertials[self.last].with_point(mass, place)

    def lay_surface(self, height: float, stiffness: float) -> None:
        """Put a surface in the way of the tool, or of the last link's end.

        Args:
            height: Height above the base's origin, m.
            stiffness: Force per depth, N/m.
        """
        self.surface = np.array([height, stiffness])

    def restamp_motion(self, taken: Clock) -> None:
        """Log positions and speeds as they were at other times than their stamps say.

        Args:
            taken: Function that turns time stamps into the times of the measurements, s. [T] -> [T].
        """
        self.clocks.append(taken)

    def taken(self, stamps: Array) -> Array:
        """Compute when the positions and speeds of given time stamps were measured, s. [T] -> [T]."""
        for clock in reversed(self.clocks):
            stamps = clock(stamps)
        return stamps


def delayed(values: Array, seconds: float, step: float) -> Array:
    """Delay commands; before the first one arrives, the first one holds.

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
    """Filter commands by a first-order lag that has settled at the first command; exact for lines between commands.

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
    # A filter that is exact for commands held over each step would have another lag: its output would be half a step too early.
    old = seconds / step * (1 - keep)
    return lfilter([1 - old, old - keep], [1, -keep], values, axis=0, zi=old * values[:1])[0]
