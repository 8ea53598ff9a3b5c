"""Check that the arm reaches its workspace: inverse kinematics over a grid of poses, done once at start-up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.robot.kinematics import REACHED_M, REACHED_RAD, Kinematics
from gsbridge.robot.limits import Workspace


def tool_down(position: Array, yaw: Array | float = 0.0) -> Array:
    """Return tool poses that point straight down.

    Args:
        position: Tool points, m. [..., 3].
        yaw: Turn about the vertical, rad; at 0 the tool's x axis (the camera's side) is along the frame's x. [...].

    Returns:
        `frame_from_tool` with z down. [..., 4, 4].
    """
    position, yaw = np.asarray(position, dtype=np.float64), np.asarray(yaw, dtype=np.float64)
    out = np.zeros((*np.broadcast(position[..., 0], yaw).shape, 4, 4))
    cosine, sine = np.cos(yaw), np.sin(yaw)
    out[..., 0, 0], out[..., 0, 1] = cosine, sine
    out[..., 1, 0], out[..., 1, 1] = sine, -cosine
    out[..., 2, 2] = -1.0
    out[..., :3, 3] = position
    out[..., 3, 3] = 1.0
    return out


@dataclass(frozen=True)
class Reach:
    """Results of inverse kinematics over a grid of M tool poses.

    Args:
        positions: Tool points, table frame, m. [M, 3].
        yaws: Yaws of the tool, rad. [M].
        position_errors: Distance by which each pose is missed, m. [M].
        angle_errors: Angle by which each pose is missed, rad. [M].
        margins: Smallest distance of any joint to its limit, rad. [M].
    """

    positions: Array
    yaws: Array
    position_errors: Array
    angle_errors: Array
    margins: Array

    @property
    def reached(self) -> Array:
        """Mask of the poses that count as reached, bool. [M]."""
        return (self.position_errors <= REACHED_M) & (self.angle_errors <= REACHED_RAD)


def residual_grid(
    kinematics: Kinematics, base_from_table: Array, workspace: Workspace, *, counts: tuple[int, int, int, int] = (5, 5, 3, 3)
) -> Reach:
    """Solve inverse kinematics on a grid over a workspace, corners included, with the tool pointing down.

    Args:
        kinematics: The robot.
        base_from_table: Pose of the table. [4, 4].
        workspace: Box and yaw range, table frame.
        counts: Number of grid points along x, y, z and yaw; a single point lies in the middle of the range.

    Returns:
        One entry per grid pose. Every solution starts from the rest posture, as the first command does.
    """
    lows, highs = (*workspace.lower, workspace.yaw[0]), (*workspace.upper, workspace.yaw[1])
    axes = [np.linspace(a, b, n) if n > 1 else np.array([0.5 * (a + b)]) for a, b, n in zip(lows, highs, counts, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)
    targets = np.asarray(base_from_table) @ tool_down(grid[:, :3], grid[:, 3])
    found = [kinematics.inverse(target) for target in targets]
    limits = kinematics.arm_limits
    return Reach(
        grid[:, :3],
        grid[:, 3],
        np.array([item.position_error_m for item in found]),
        np.array([item.angle_error_rad for item in found]),
        np.array([limits.margin(item.q).min() for item in found]),
    )


def require_reach(kinematics: Kinematics, base_from_table: Array, workspace: Workspace, source: str) -> Reach:
    """Check that the arm reaches a workspace.

    Args:
        kinematics: The robot.
        base_from_table: Pose of the table. [4, 4].
        workspace: The box that the task needs.
        source: Setting or file that gave the table's pose, for the error message.

    Returns:
        The residuals, for the record.

    Raises:
        InputError: Some pose is out of reach.
    """
    reach = residual_grid(kinematics, base_from_table, workspace)
    missed = ~reach.reached
    if missed.any():
        worst = int(np.argmax(reach.position_errors))
        count = f"{np.count_nonzero(missed)} of {len(missed)}"
        at = ", ".join(f"{value:.2f}" for value in reach.positions[worst])
        raise InputError(
            source,
            f"the arm misses {count} tool poses of the working area, at ({at}) m of the table by"
            f" {1000 * reach.position_errors[worst]:.0f} mm",
            "Move the table or the start region nearer to 0.60 m in front of the robot's base, or check the registration",
        )
    return reach
