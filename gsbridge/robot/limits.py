"""Limits of the joints and of the space in which the tool may move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.robot.links import Joint
from gsbridge.robot.nominal import WORK_CENTRE
from gsbridge.robot.urdf import read_urdf


@dataclass(frozen=True)
class JointLimits:
    """Limits of several joints.

    Args:
        names: Joint names.
        lower: Smallest angles, rad. [N].
        upper: Largest angles, rad. [N].
        velocity: Largest speeds, rad/s. [N].
        effort: Largest torques, N m. [N].
    """

    names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    effort: Array

    @classmethod
    def of(cls, joints: Sequence[Joint]) -> JointLimits:
        """Collect the limits of these joints."""
        values = np.array([(j.lower, j.upper, j.velocity, j.effort) for j in joints], dtype=np.float64).reshape(-1, 4)
        return cls(tuple(joint.name for joint in joints), *(np.ascontiguousarray(column) for column in values.T))

    @classmethod
    def read(cls, urdf: str | Path, names: Sequence[str] | None = None) -> JointLimits:
        """Read limits from a description, for the named joints or all moving ones.

        Raises:
            InputError: The file cannot be used, a joint is missing, or a limit makes no sense.
        """
        joints = {joint.name: joint for joint in read_urdf(urdf).moving}
        for name in names or ():
            if name not in joints:
                raise InputError(urdf, f"the description has no moving joint '{name}'", f"Use one of: {', '.join(joints)}")
        out = cls.of([joints[name] for name in (joints if names is None else names)])
        for name, low, high, speed, effort in zip(out.names, out.lower, out.upper, out.velocity, out.effort, strict=True):
            if not (low < high and speed > 0 and effort > 0):
                raise InputError(urdf, f"joint '{name}' has an empty range, no speed or no torque", "Correct its limits")
        return out

    def inside(self, q: Array) -> Array:
        """Whether each angle lies within its limits, give or take 1e-9 rad of rounding. [..., N] -> bool [..., N]."""
        return (np.asarray(q) >= self.lower - 1e-9) & (np.asarray(q) <= self.upper + 1e-9)

    def clip(self, q: Array) -> Array:
        """Return the angles cut to their limits, rad. [..., N]."""
        return np.minimum(np.maximum(q, self.lower), self.upper)

    def margin(self, q: Array) -> Array:
        """Return the distance to the nearer limit, rad; negative outside the limits. [..., N]."""
        return np.minimum(np.asarray(q) - self.lower, self.upper - np.asarray(q))

    def follow(self, q: Array, wanted: Array, seconds: float) -> Array:
        """Return the next command on the way to `wanted`, with no joint above its speed limit or outside its range.

        All joints slow down by the same factor, as in any arm's controller. If each joint were limited on its own, the tool
        would leave its path, and a slow elbow could drive it into the table.

        Args:
            q: Last command, rad. [..., N].
            wanted: Angles to move towards, rad. [..., N].
            seconds: Time until the next command, s.

        Returns:
            The next command, rad. [..., N].
        """
        way = self.clip(wanted) - np.asarray(q)
        slowest = np.max(np.abs(way) / (self.velocity * seconds), axis=-1, keepdims=True)
        return self.clip(np.asarray(q) + way / np.maximum(1.0, slowest))


@dataclass(frozen=True)
class Workspace:
    """The box in which the tool point may be commanded, and the range of its yaw; table frame, m and rad.

    Args:
        lower: Smallest x, y, z. Half a pad is 32.5 mm long, so the fingertips just clear the table at z = 35 mm.
        upper: Largest x, y, z.
        yaw: Smallest and largest yaw about the table's z.
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    yaw: tuple[float, float] = (-0.5 * np.pi, 0.5 * np.pi)

    @classmethod
    def around(
        cls, centre: tuple[float, float] = WORK_CENTRE, side: float = 0.34, heights: tuple[float, float] = (0.035, 0.35)
    ) -> Workspace:
        """Return a square column about a point of the table; by default the start region and 20 mm around it.

        Args:
            centre: x and y of the column's middle, table frame, m. [2].
            side: Edge of the square, m.
            heights: Lowest and highest z, table frame, m.
        """
        half = side / 2
        low, high = heights
        return cls((centre[0] - half, centre[1] - half, low), (centre[0] + half, centre[1] + half, high))

    def __post_init__(self) -> None:
        low, high = np.array([*self.lower, self.yaw[0]]), np.array([*self.upper, self.yaw[1]])
        fits = low.shape == high.shape == (4,)
        if not (fits and np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()):
            raise InputError(
                "workspace", "a lower bound does not lie below its upper bound", "Give metres and radians, low < high"
            )

    def clip(self, position: Array, yaw: float) -> tuple[Array, float, bool]:
        """Cut a command to the box.

        Args:
            position: Tool point, table frame, m. [3].
            yaw: Commanded yaw, rad.

        Returns:
            Position [3], yaw, and whether anything was cut.

        Raises:
            InputError: The command is not finite.
        """
        # Use plain numbers: for so few values, numpy takes several times as long.
        wanted = [*np.asarray(position, dtype=np.float64).tolist(), float(yaw)]
        if not all(map(isfinite, wanted)):
            raise InputError("action", "the commanded pose is not finite", "Check the policy's output for NaN")
        bounds = zip(wanted, (*self.lower, self.yaw[0]), (*self.upper, self.yaw[1]), strict=True)
        *inside, turn = (min(max(value, low), high) for value, low, high in bounds)
        return np.array(inside), turn, [*inside, turn] != wanted

    def contains(self, position: Array) -> Array:
        """Whether points lie in the box. [..., 3] -> bool [...]."""
        position = np.asarray(position)
        return np.asarray(np.all((position >= self.lower) & (position <= self.upper), axis=-1))


@dataclass
class ClippedCommands:
    """A workspace that counts the commands it cuts, so that the records show a policy that often commands poses outside it.

    Args:
        workspace: The box.
        commands: Number of commands seen.
        clipped: Number of commands that had to be cut.
    """

    workspace: Workspace = field(default_factory=Workspace.around)
    commands: int = 0
    clipped: int = 0

    def clip(self, position: Array, yaw: float) -> tuple[Array, float]:
        """Cut a command (tool point, m [3], and yaw, rad) as `Workspace.clip` does, and count it."""
        inside, turn, cut = self.workspace.clip(position, yaw)
        self.commands += 1
        self.clipped += cut
        return inside, turn
