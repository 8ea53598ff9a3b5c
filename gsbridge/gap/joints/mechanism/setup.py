"""What one simulation is made of: the nominal figures of a mechanism, which effects change before it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from gsbridge.gap.joints.mechanism.inertials import Inertial
from gsbridge.gap.joints.mechanism.joint_kernel import LAW
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel
from gsbridge.geometry import Array

CommandFilter = Callable[[Array, float], Array]
"""Commands on the grid of the physics [K, N] and its step in s -> commands that reach the controller [K, N]."""

Output = Callable[[Array, dict[str, Array]], dict[str, Array]]
"""Times [K] in s and channels, each [K, N] -> channels as they are logged. [K, N]."""


@dataclass
class JointSetup:
    """A mechanism ready to be simulated.

    Args:
        law: Figures of the joints, by their names in `gsbridge.gap.joints.mechanism.joint_kernel.LAW`. Each [N].
        gravity: As it acts, base frame, m/s2; the controller believes in the nominal one. [3].
        inertials: Mass properties of the links as they are; the controller believes in the nominal ones.
        child_of: Link that each joint moves.
        joints: Their names.
        commands: Hooks on the way of the commands.
        outputs: Hooks on the way to the log.
    """

    law: dict[str, Array]
    gravity: Array
    inertials: dict[str, Inertial]
    child_of: dict[str, str]
    joints: tuple[str, ...]
    commands: list[CommandFilter] = field(default_factory=list)
    outputs: list[Output] = field(default_factory=list)

    @classmethod
    def nominal(cls, system: MechanismModel, inertials: dict[str, Inertial], child_of: dict[str, str]) -> JointSetup:
        """Of a mechanism without effects."""
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
