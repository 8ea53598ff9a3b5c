"""What a policy requires to run: pictures, workspace, steps and start poses, read from `policy.json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from gsbridge.cameras import Camera
from gsbridge.environment.proprioception import PROPRIO_BOUND
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings, Plate
from gsbridge.errors import InputError
from gsbridge.geometry import Array, rotation_angle
from gsbridge.policy.format import ACTION_NAMES, PROPRIO_NAMES, SPEC
from gsbridge.reading import refusing
from gsbridge.registration.result import Registration, pose_error
from gsbridge.robot.assembly import check_reach, check_rigid
from gsbridge.robot.limits import Workspace
from gsbridge.sim.actions import TETHER, ToolTarget
from gsbridge.tasks.world import CONTROL_HZ

MOUNT_M, MOUNT_RAD = 0.010, np.deg2rad(2.0)
"""Largest change of the camera's mount since the training, m and rad; it moves a picture of 64 px by a few pixels."""

LARGEST = 2.0
"""Largest distance of a workspace's corner from the middle of the board along an axis, and largest opening of a hand, m."""
_WORKSPACE = "Give metres and radians, over the table"

START_M, START_RAD = 0.050, 0.25
"""Largest distance, m, and turn, rad, from the tool pose in which episodes of the training began."""


@dataclass(frozen=True)
class PolicyInterface:
    """Inputs and outputs of a policy, and settings of its episodes.

    Args:
        camera: Pinhole of the picture that the policy takes.
        workspace: Room in which the tool is commanded, table frame.
        stroke: Largest opening of the gripper, m.
        settings: Task, steps and start poses.
        control_hz: Actions per second.
        flange_from_camera: Mount of the camera in the training, OpenCV axes, [4, 4]; None if there was no arm.
        table_from_tool_at_rest: Pose of the tool when an episode begins, [4, 4]; None if there was no arm.
        base_from_table: Pose of the table in the training, [4, 4]; None if there was no arm.
    """

    camera: Camera
    workspace: Workspace
    stroke: float
    settings: EnvironmentSettings
    control_hz: float
    flange_from_camera: Array | None = None
    table_from_tool_at_rest: Array | None = None
    base_from_table: Array | None = None

    @classmethod
    def of(cls, spec: Mapping[str, Any]) -> PolicyInterface:
        """Take the interface from the content of `policy.json`.

        Raises:
            InputError: An entry is missing or damaged, or the actions were meant for another runner.
        """
        try:
            with refusing(SPEC, "it does not say how to run the policy", "Train the policy again"):
                out = cls._read(spec)
        except InputError as error:
            source = error.source if error.source.startswith(SPEC) else f"{SPEC}: {error.source}"
            raise InputError(source, error.problem, error.remedy) from error
        return out

    @classmethod
    def _read(cls, spec: Mapping[str, Any]) -> PolicyInterface:
        image, proprio, robot = spec["observation"]["image"], spec["observation"]["proprio"], spec["robot"]
        low, high, yaw = (
            _numbers(proprio, f"workspace_{name}", count) for name, count in (("lower_m", 3), ("upper_m", 3), ("yaw_rad", 2))
        )
        if not (min(low) >= -LARGEST and max(high) <= LARGEST and low[2] >= 0.0 and -np.pi <= yaw[0] <= yaw[1] <= np.pi):
            raise InputError("workspace", f"it goes from {low} to {high} m and from {yaw[0]} to {yaw[1]} rad", _WORKSPACE)
        (stroke,), (width,) = _numbers(proprio, "stroke_m", 1), _numbers(image, "field_of_view_rad", 1)
        if not 0.0 < stroke <= LARGEST:
            raise InputError("stroke_m", f"{stroke} m is no opening of a hand", "Give metres")
        settings = _settings(spec["environment"])
        poses = ("flange_from_camera", "table_from_tool_at_rest", "base_from_table")
        out = cls(
            wrist_camera(settings.image_size, width),
            Workspace((low[0], low[1], low[2]), (high[0], high[1], high[2]), (yaw[0], yaw[1])),
            stroke,
            settings,
            CONTROL_HZ,
            *(None if robot is None else check_reach(check_rigid(robot[key], key), key) for key in poses),
        )
        _refuse_other_runners(spec, settings)
        return out

    def target(self) -> ToolTarget:
        """Make the commanded tool pose, with the workspace and action scale of the training."""
        return ToolTarget.within(self.workspace, self.stroke, self.settings.action_scale())

    def check_mount(self, registration: Registration) -> tuple[float, float] | None:
        """Compare the registered mount of the camera with the training's.

        Returns:
            Their distance, m, and angle, rad; None if the training had no arm.

        Raises:
            InputError: The camera has been moved since the training.
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

    def check_table(self, registration: Registration) -> None:
        """Check that the table stands where episodes can begin as in the training: the rest posture is fixed in the joints.

        Raises:
            InputError: The table has been moved by more than a start may differ.
        """
        if self.base_from_table is None or self.table_from_tool_at_rest is None:
            return
        now = np.linalg.inv(registration.base_from_table) @ self.base_from_table @ self.table_from_tool_at_rest
        shift, turn = pose_error(now, self.table_from_tool_at_rest)
        if shift > START_M or turn > START_RAD:
            raise InputError(
                "registration: base_from_table",
                f"by the registration, the rest posture is {1000 * shift:.0f} mm and {np.degrees(turn):.0f} degrees from where"
                " it was over the table in the training: table or board have been moved that far",
                "Put them back and register again, or train with the new registration",
            )

    def check_start(self, table_from_tool: Array) -> None:
        """Check that an episode begins where those of the training did.

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


def _refuse_other_runners(spec: Mapping[str, Any], settings: EnvironmentSettings) -> None:
    """Refuse a policy whose file describes another way of running it than this version has.

    Raises:
        InputError: Order, size, rate or meaning of observations or actions differ.
    """
    scale = settings.action_scale()
    wanted: dict[tuple[str, ...], Any] = {
        ("control_hz",): CONTROL_HZ,
        ("task",): settings.task,
        ("observation", "image", "size_px"): settings.image_size,
        ("observation", "proprio", "names"): list(PROPRIO_NAMES),
        ("observation", "proprio", "bound"): PROPRIO_BOUND,
        ("action", "names"): list(ACTION_NAMES),
        ("action", "low"): -1.0,
        ("action", "high"): 1.0,
        ("action", "position_m"): scale.position,
        ("action", "yaw_rad"): scale.yaw,
        ("action", "aperture_m"): scale.aperture,
        ("action", "tether"): TETHER,
    }
    for keys, value in wanted.items():
        found: Any = spec
        for key in keys:
            found = found[key]
        if isinstance(found, bool) or found != value:
            said = f"its {'.'.join(keys)} is {str(found)[:80]}, this version commands arms in another way: {value}"
            raise InputError(SPEC, said, "Run it with the gsbridge that trained it")


def _numbers(content: Mapping[str, Any], name: str, count: int) -> tuple[float, ...]:
    """Read the finite numbers of an entry, which is a list if there are several.

    Args:
        content: Entries by name.
        name: Name of the entry.
        count: How many numbers there must be.

    Raises:
        InputError: Their number differs, or one is not a finite number.
    """
    values = [content[name]] if count == 1 else content[name]
    numbers = isinstance(values, list | tuple) and all(type(value) in (int, float) and isfinite(value) for value in values)
    if not numbers or len(values) != count:
        raise InputError(name, f"{str(content[name])[:80]} is not {count} finite numbers", "Give metres and radians")
    return tuple(float(value) for value in values)


def _settings(content: Mapping[str, Any]) -> EnvironmentSettings:
    """Read settings of the environment from JSON, which has lists for tuples."""
    for name in ("start_centre", "start_yaw"):
        _numbers(content, name, 2)
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in content.items()}
    plate = values.pop("plate")
    return EnvironmentSettings(**values, plate=None if plate is None else Plate(**plate))
