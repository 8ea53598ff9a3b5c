"""The interface of a world to an environment, whichever simulator or robot stands behind it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from gsbridge.geometry import Array
from gsbridge.tasks.state import State

CONTROL_HZ = 20
"""Commands per second, on which policies, simulators and robots agree."""


@runtime_checkable
class World(Protocol):
    """One robot, one object, one table. Table frame, SI units, radians; every call refers to one and the same world."""

    def reset(self, object_pose: Array, seed: int) -> None:
        """Begin an episode: object set down at rest, arm in its rest posture, gripper open.

        Args:
            object_pose: x, y, yaw of the body frame on the table. [3].
            seed: Seed of everything random in the episode. The same pose, seed and commands give the same episode.

        Raises:
            InputError: The pose is not finite.
        """

    def command(self, position: Array, yaw: float, aperture: float) -> None:
        """Set the target that `step` moves to and holds; tool pointing down.

        Args:
            position: Tool point, table frame, m. [3].
            yaw: Turn of the tool about the vertical, rad, 0 with the camera's side along the table's x.
            aperture: Distance of the pads, m.

        Raises:
            InputError: The target is not finite.
        """

    def step(self) -> None:
        """Advance one control period."""

    def state(self) -> State:
        """The world as the tasks see it, of length 1. Contact forces are means over the last control period."""

    def joints(self) -> tuple[Array, Array, Array]:
        """Angles, speeds and motor torques of the arm's joints and the gripper's driver. [8], [8], [8]."""

    def body_poses(self) -> Mapping[str, Array]:
        """`table_from_body` of the object (`object`) and of every link of the robot (by its name). Each [4, 4]."""

    def camera_pose(self) -> Array:
        """`cam_from_table` of the wrist camera, OpenCV axes. [4, 4]."""


@runtime_checkable
class SeeingWorld(World, Protocol):
    """A world with a camera of its own; for other worlds, a renderer draws the pictures from `body_poses`."""

    def image(self, size: int) -> Array:
        """Picture of the wrist camera now. uint8 [size, size, 3]."""
