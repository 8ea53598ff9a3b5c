"""What a policy asks of whoever runs it: pictures, room, steps and start poses, read from `policy.json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings, Plate
from gsbridge.errors import InputError
from gsbridge.geometry import Array, rotation_angle
from gsbridge.policy.format import SPEC
from gsbridge.registration.result import Registration, pose_error
from gsbridge.robot.assembly import check_rigid
from gsbridge.robot.limits import Workspace
from gsbridge.sim.actions import TETHER, ToolTarget

MOUNT_M, MOUNT_RAD = 0.010, np.deg2rad(2.0)
"""Largest change of the camera's mount since the training: what it shows has moved by some pixels of 64 then."""

START_M, START_RAD = 0.050, 0.25
"""Largest distance from where episodes of the training began."""


@dataclass(frozen=True)
class PolicyInterface:
    """What goes in and out of a policy, and what an episode of it is.

    Args:
        camera: Pinhole of the picture that the policy takes.
        workspace: Room in which the tool is commanded, table frame.
        stroke: Largest opening of the gripper, m.
        settings: Task, steps and start poses.
        control_hz: Actions per second.
        flange_from_camera: Mount of the camera in the training, OpenCV axes, [4, 4]; None where it had none.
        table_from_tool_at_rest: Where the tool stands when an episode begins, [4, 4]; None where there was no arm.
    """

    camera: Camera
    workspace: Workspace
    stroke: float
    settings: EnvironmentSettings
    control_hz: float
    flange_from_camera: Array | None = None
    table_from_tool_at_rest: Array | None = None

    @classmethod
    def of(cls, spec: Mapping[str, Any]) -> PolicyInterface:
        """Take the interface from the content of `policy.json`.

        Raises:
            InputError: An entry is missing or damaged, or the actions were meant for another runner.
        """
        try:
            image, proprio, robot = spec["observation"]["image"], spec["observation"]["proprio"], spec["robot"]
            low, high, yaw = (tuple(proprio[f"workspace_{name}"]) for name in ("lower_m", "upper_m", "yaw_rad"))
            poses = ("flange_from_camera", "table_from_tool_at_rest")
            out = cls(
                wrist_camera(int(image["size_px"]), float(image["field_of_view_rad"])),
                Workspace(low, high, yaw),
                float(proprio["stroke_m"]),
                _settings(spec["environment"]),
                float(spec["control_hz"]),
                *(None if robot is None else check_rigid(robot[key], f"{SPEC}: {key}") for key in poses),
            )
            tether = float(spec["action"]["tether"])
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(SPEC, f"it does not say how to run the policy ({error!r})", "Train the policy again") from error
        if tether != TETHER:
            raise InputError(SPEC, "this version commands arms in another way", "Run it with the gsbridge that trained it")
        return out

    def target(self) -> ToolTarget:
        """The commanded tool pose, as in the training."""
        return ToolTarget.within(self.workspace, self.stroke, self.settings.action_scale())

    def check_mount(self, registration: Registration) -> tuple[float, float] | None:
        """Compare the registered mount of the camera with the training's.

        Returns:
            Their distance, m, and angle, rad; None where the training had no camera.

        Raises:
            InputError: The camera has been moved since.
        """
        if self.flange_from_camera is None:
            return None
        shift, turn = pose_error(registration.flange_from_camera, self.flange_from_camera)
        if shift > MOUNT_M or turn > MOUNT_RAD:
            raise InputError(
                "registration: flange_from_camera",
                f"the camera sits {1000 * shift:.0f} mm and {np.degrees(turn):.1f} degrees from where it sat in the training",
                "Put it back and register again, or train with the new registration",
            )
        return shift, turn

    def check_start(self, table_from_tool: Array) -> None:
        """Make sure that an episode begins where those of the training did.

        Args:
            table_from_tool: Measured pose of the tool, m. [4, 4].

        Raises:
            InputError: The tool stands elsewhere: the arm is not in its rest posture, or a frame is wrong.
        """
        if self.table_from_tool_at_rest is None:
            return
        away = table_from_tool[:3, 3] - self.table_from_tool_at_rest[:3, 3]
        turn = float(rotation_angle(table_from_tool[:3, :3].T @ self.table_from_tool_at_rest[:3, :3]))
        if np.linalg.norm(away) > START_M or turn > START_RAD:
            x, y, z = 1000 * away
            raise InputError(
                "start of the episode",
                f"the tool stands ({x:+.0f}, {y:+.0f}, {z:+.0f}) mm and {np.degrees(turn):.0f} degrees from where the policy"
                " begins, in the table frame",
                "Drive the arm to its rest posture; if it stands there, check the driver's frames and the registration",
            )


def _settings(content: Mapping[str, Any]) -> EnvironmentSettings:
    """Settings of the environment from JSON, which knows no tuples."""
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in content.items()}
    plate = values.pop("plate")
    return EnvironmentSettings(**values, plate=None if plate is None else Plate(**plate))
