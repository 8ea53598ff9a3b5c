"""Actions of a policy, 20 per second: steps of the tool's commanded pose and of the gripper's opening."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.robot.limits import ClippedCommands, Workspace

SIZE = 5
"""Entries of an action: x, y, z, yaw, opening; each -1 to 1."""


TETHER = 1.5
"""How far the command may be ahead of the arm, in actions of 1. With more, an arm with latency overshoots and may run into the
object. Episodes do not take longer because of the bound."""


@dataclass(frozen=True)
class ActionScale:
    """Motion that an entry of 1 commands, per control step.

    Args:
        position: Step of the tool point along each axis of the table, m.
        yaw: Turn, rad.
        aperture: Change of the opening, m; positive opens.

    Source: RL-GSBridge's code: three sub-steps of 8 mm, 0.05 rad and a tenth of the gripper's range.
    """

    position: float = 0.024
    yaw: float = 0.15
    aperture: float = 0.042

    def __post_init__(self) -> None:
        if not all(np.isfinite(value) and value > 0 for value in (self.position, self.yaw, self.aperture)):
            raise InputError("action scale", "a step is not positive", "Give metres and radians per control step")


def checked_action(action: Array) -> list[float]:
    """The entries of an action. [5].

    Raises:
        InputError: It has another shape or is not finite.
    """
    action = np.asarray(action, dtype=np.float64)
    if action.shape != (SIZE,):
        raise InputError("action", f"it has the shape {action.shape}, expected ({SIZE},)", "Give x, y, z, yaw, opening")
    values: list[float] = action.tolist()
    if not all(map(isfinite, values)):
        raise InputError("action", "it is not finite", "Check the policy's output for NaN")
    return values


@dataclass
class ToolTarget:
    """The commanded tool pose. Actions are added to the command, not to the measured pose, so that lag does not add up.

    Args:
        stroke: Largest opening of the gripper, m.
        scale: Motion that an entry of 1 commands.
        counted: Workspace that positions and yaws are cut to, with counts of the commands and of those cut.
        position: Tool point, table frame, m. [3].
        yaw: Turn of the tool about the vertical, rad.
        aperture: Opening, m.
        saturated: Number of actions with an entry outside -1..1, which was cut.
    """

    stroke: float
    scale: ActionScale = field(default_factory=ActionScale)
    counted: ClippedCommands = field(default_factory=ClippedCommands)
    position: Array = field(default_factory=lambda: np.zeros(3))
    yaw: float = 0.0
    aperture: float = 0.0
    saturated: int = 0

    @classmethod
    def within(cls, workspace: Workspace, stroke: float, scale: ActionScale | None = None) -> ToolTarget:
        """A target that keeps to a workspace.

        Args:
            workspace: Box that positions and yaws are cut to.
            stroke: Largest opening of the gripper, m.
            scale: Motion that an entry of 1 commands; None for the default.
        """
        return cls(stroke, scale or ActionScale(), ClippedCommands(workspace))

    def reset(self, position: Array, yaw: float, aperture: float) -> None:
        """Begin an episode at a tool pose; the counters begin anew, too.

        Args:
            position: Tool point, table frame, m. [3].
            yaw: Turn of the tool about the vertical, rad.
            aperture: Opening, m.
        """
        self.position, self.yaw, self.aperture = np.array(position, dtype=np.float64), float(yaw), float(aperture)
        self.counted.commands = self.counted.clipped = self.saturated = 0

    def tether(self, position: Array, yaw: float, aperture: float) -> None:
        """Hold the command back to within `TETHER` actions of the arm and of the fingers.

        Without this bound, the command of an arm that is slowed down by joint speed limits, latency or an obstacle would run
        ahead; the arm would overshoot, and new actions would not steer it. Fingers that press on something go on pressing, and
        open at the second action that opens them.

        Args:
            position: Measured tool point, table frame, m. [3].
            yaw: Measured yaw, rad.
            aperture: Measured opening, m.
        """
        point = position.tolist()
        if not all(map(isfinite, (*point, yaw, aperture))):
            return
        reach, turn = TETHER * self.scale.position, TETHER * self.scale.yaw
        # Plain numbers: on so few of them numpy takes several times as long.
        pairs = zip(point, self.position.tolist(), strict=True)
        self.position = np.array([at + min(max(wanted - at, -reach), reach) for at, wanted in pairs])
        self.yaw = yaw + min(max((self.yaw - yaw + np.pi) % (2 * np.pi) - np.pi, -turn), turn)
        width = TETHER * self.scale.aperture
        self.aperture = min(max(self.aperture, aperture - width), aperture + width)

    def move(self, action: Array) -> tuple[Array, float, float]:
        """Add one action.

        Args:
            action: x, y, z, yaw, opening, each -1..1 (cut, and counted, where it is not). [5].

        Returns:
            Position [3], yaw and aperture to give to a world's `command`.

        Raises:
            InputError: The action has another shape or is not finite.
        """
        values = checked_action(action)
        *step, turn, opening = cut = [min(max(value, -1.0), 1.0) for value in values]
        self.saturated += cut != values
        # Each axis is scaled by itself (a cube, not a ball), as in the paper: a diagonal action moves farther than others.
        position = [at + self.scale.position * part for at, part in zip(self.position.tolist(), step, strict=True)]
        self.position, self.yaw = self.counted.clip(np.array(position), self.yaw + self.scale.yaw * turn)
        self.aperture = min(max(self.aperture + self.scale.aperture * opening, 0.0), self.stroke)
        return self.position, self.yaw, self.aperture
