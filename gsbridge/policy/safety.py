"""Safety checks between policy and hardware: of measurements, pictures, actions and commands."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gsbridge.environment.proprioception import Reached
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.policy.driver import Reading
from gsbridge.robot.limits import Workspace
from gsbridge.sim.actions import TETHER, ActionScale


class End(StrEnum):
    """Why an episode ended."""

    TIME_OUT = "time_out"
    """All its steps were taken; episodes of a real arm normally end so."""
    DONE = "done"
    """The task's rules saw a success."""
    BAD_ACTION = "bad_action"
    """The policy's action is not finite or has another shape."""
    BAD_READING = "bad_reading"
    """The arm's measurement is no pose, not finite, or an opening that the hand cannot have."""
    JUMP = "jump"
    """The tool was measured farther from its last place than an arm can move in a step."""
    TILT = "tilt"
    """The tool no longer points down."""
    OUTSIDE = "outside"
    """The tool was measured outside the workspace."""
    LARGE_STEP = "large_step"
    """The next command is farther from the tool than the tether allows, which means an error in the runner itself."""
    REFUSED = "refused"
    """The arm refused several commands in a row."""
    FROZEN = "frozen"
    """The camera delivers the same picture again and again."""
    STUCK = "stuck"
    """The arm is measured at the very same place again and again, while it is commanded elsewhere."""
    STALLED = "stalled"
    """A step took far too long."""
    INTERRUPTED = "interrupted"
    """The user pressed Ctrl-C."""
    ERROR = "error"
    """Driver or policy raised an error."""


@dataclass(frozen=True)
class Limits:
    """Limits beyond which a guard ends the episode.

    Args:
        jump: Distance that the tool moves within one step, m.
        turn: Turn of the tool within one step, rad.
        tilt: Angle of the tool from the vertical, rad.
        margin: Distance of the tool outside the workspace, m; not zero, since an arm overshoots and starts above it.
        refusals: Consecutive commands that the arm refuses.
        frozen: Consecutive equal pictures, or equal poses of an arm that is commanded elsewhere; None for simulated worlds,
            which have no noise.
        stall: Delay of a step, s.

    Raises:
        InputError: A limit is not positive.
    """

    jump: float = 0.10
    turn: float = 0.60
    tilt: float = 0.20
    margin: float = 0.05
    refusals: int = 10
    frozen: int | None = 10
    stall: float = 0.5

    def __post_init__(self) -> None:
        numbers = (self.jump, self.turn, self.tilt, self.margin, self.refusals, self.stall, self.frozen or 1)
        if not all(np.isfinite(value) and value > 0 for value in numbers):
            raise InputError("limits", f"{self} holds a limit that is not positive", "Give metres, radians, seconds and counts")


_OPENING_M = 0.02
"""Error of a measured opening, m, beyond which it must be in another unit or of another hand."""

_ELSEWHERE = 0.5
"""Share of the tether at which a command counts as elsewhere: an arm that sags or lags is nearer to its command."""


class Guard:
    """Checks all measurements, pictures, actions and commands of one episode.

    Args:
        limits: See `Limits`.
        workspace: Room in which the tool is commanded.
        scale: Motion that an action of 1 commands.
        stroke: Largest opening of the hand, m.
    """

    def __init__(self, limits: Limits, workspace: Workspace, scale: ActionScale, stroke: float) -> None:
        self.limits, self.workspace, self.scale, self.stroke = limits, workspace, scale, stroke
        self._last: Reached | None = None
        self._picture: Array | None = None
        self._pose: Array | None = None
        self._equal = self._refused = self._still = self._stuck = 0

    def reading(self, reading: Reading, table_from_base: Array) -> tuple[End | None, Array | None]:
        """Check a measurement, also by its distance from the one before.

        Args:
            reading: What the arm measured.
            table_from_base: Pose of the robot's base in the table frame. [4, 4].

        Returns:
            Why the episode must end, or None; and `table_from_tool`, [4, 4], or None if the reading is no pose.
        """
        try:
            pose, aperture = np.asarray(reading.base_from_tool, dtype=np.float64), float(reading.aperture)
        except (AttributeError, TypeError, ValueError):
            return End.BAD_READING, None
        if not -_OPENING_M <= aperture <= self.stroke + _OPENING_M:
            return End.BAD_READING, None
        self._still = self._still + 1 if self._pose is not None and np.array_equal(self._pose, pose) else 0
        self._pose = np.array(pose)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            return End.BAD_READING, None
        turn = pose[:3, :3]
        if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-3 or np.linalg.det(turn) < 0 or (pose[3] != [0, 0, 0, 1]).any():
            return End.BAD_READING, None
        table_from_tool = table_from_base @ pose
        return self._moved(table_from_tool, aperture), table_from_tool

    def _moved(self, table_from_tool: Array, aperture: float) -> End | None:
        """Check a pose by itself and against the one before. [4, 4]."""
        now, last = Reached.of_pose(table_from_tool, aperture), self._last
        self._last = now
        # The tool's z axis points down, so that its z component in the table frame is near -1.
        if np.arccos(np.clip(-table_from_tool[2, 2], -1.0, 1.0)) > self.limits.tilt:
            return End.TILT
        beyond = np.maximum(np.array(self.workspace.lower) - now.position, now.position - self.workspace.upper)
        if beyond.max() > self.limits.margin:
            return End.OUTSIDE
        if last is not None:
            turned = abs((now.yaw - last.yaw + np.pi) % (2 * np.pi) - np.pi)
            if np.linalg.norm(now.position - last.position) > self.limits.jump or turned > self.limits.turn:
                return End.JUMP
        return None

    def follows(self, position: Array, yaw: float) -> End | None:
        """Check that the arm moves, if it was commanded far from where it is measured.

        Args:
            position: The last command, table frame, m. [3].
            yaw: Commanded yaw, rad.

        Returns:
            Why the episode must end; None if the arm moves, or need not.
        """
        if self.limits.frozen is None or self._last is None:
            return None
        # Of the tether and the action that is added to it.
        reach = _ELSEWHERE * (TETHER + 1.0)
        far, turn = reach * self.scale.position, reach * self.scale.yaw
        turned = abs((yaw - self._last.yaw + np.pi) % (2 * np.pi) - np.pi)
        elsewhere = np.abs(position - self._last.position).max() >= far or turned >= turn
        self._stuck = self._stuck + 1 if elsewhere and self._still else 0
        return End.STUCK if self._stuck >= self.limits.frozen else None

    def picture(self, image: Array) -> End | None:
        """Check that a raw picture differs from those before. [H, W, 3] uint8."""
        if self.limits.frozen is None:
            return None
        same = self._picture is not None and np.array_equal(self._picture, image)
        self._equal = self._equal + 1 if same else 0
        # A copy: a driver may write its next picture into the same memory.
        self._picture = np.array(image)
        return End.FROZEN if self._equal >= self.limits.frozen else None

    def action(self, action: Array) -> End | None:
        """Check the policy's action. [5]."""
        try:
            values = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError):
            return End.BAD_ACTION
        return None if values.shape == (5,) and np.isfinite(values).all() else End.BAD_ACTION

    def command(self, position: Array, yaw: float, reached: Reached) -> End | None:
        """Check the next command; it may leave the tether only if the workspace's boundary pulls it back inside.

        Args:
            position: Commanded tool point, table frame, m. [3].
            yaw: Commanded yaw, rad.
            reached: Measured tool pose of the same step.

        Returns:
            Why the episode must end; None if the command is sound.
        """
        inside = self.workspace.clip(reached.position, reached.yaw)
        reach, turn = (TETHER + 1.0) * self.scale.position + 1e-9, (TETHER + 1.0) * self.scale.yaw + 1e-9
        # The last command is held to within `TETHER` actions of the arm, and one more action is added.
        if (np.abs(position - inside[0]) > reach).any() or abs((yaw - inside[1] + np.pi) % (2 * np.pi) - np.pi) > turn:
            return End.LARGE_STEP
        return None

    def accepted(self, answer: bool | None) -> End | None:
        """Count the commands that the driver refuses in a row, and check their number."""
        self._refused = self._refused + 1 if answer is False else 0
        return End.REFUSED if self._refused >= self.limits.refusals else None
