"""Interface that users implement for an arm of their own: five methods between the runner and the hardware.

Frames: `base` is the frame of the arm's first link as in the URDF, `tool` lies between the pads' centres when the gripper is
closed, z out of the hand, x to the camera's side, the pads open along y. Metres, radians, `a_from_b`.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
import time
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from gsbridge.cameras import Camera, camera_problem
from gsbridge.errors import GsbridgeError, InputError
from gsbridge.geometry import Array
from gsbridge.robot.assembly import RobotFiles
from gsbridge.robot.kinematics import Kinematics


@dataclass(frozen=True)
class Reading:
    """Measurement of the arm at one moment.

    Args:
        base_from_tool: Pose of the tool. [4, 4].
        aperture: Distance of the pads, m.
    """

    base_from_tool: Array
    aperture: float


@runtime_checkable
class RobotDriver(Protocol):
    """An arm with a gripper and a camera on its wrist. Every call except `rest` returns at once."""

    @property
    def camera(self) -> Camera | None:
        """Intrinsics of the pictures, distortion included; None for the camera of `registration.json`."""
        ...

    def rest(self) -> None:
        """Open the gripper, drive slowly to the rest posture, and return when the arm stands still."""

    def measure(self) -> Reading:
        """Present pose of the tool and opening, as measured, not as commanded."""

    def image(self) -> Array:
        """The newest picture, RGB as the camera delivers it. uint8 [H, W, 3]."""

    def command(self, base_from_tool: Array, aperture: float) -> bool | None:
        """Set a new target, to be reached within one control period and then held; it replaces the last one.

        Args:
            base_from_tool: Wanted pose of the tool, m. [4, 4].
            aperture: Wanted distance of the pads, m; a distance below the object's width presses on it.

        Returns:
            False if the arm cannot go there; it then keeps its last target, and the refusal is counted.
        """

    def stop(self) -> None:
        """Hold the arm where it is, now. Called at the end of every episode, after errors and on Ctrl-C, even twice."""


class JointArm:
    """Kinematics for drivers of arms that measure and take joint angles.

    Args:
        robot: Folder of the robot's description (`results/robot/description`).

    Raises:
        InputError: The folder holds no complete robot.
    """

    def __init__(self, robot: str | Path) -> None:
        files = RobotFiles.read(robot)
        self.dimensions = files.dimensions
        self.rest_posture = np.array(files.record["rest_posture"], dtype=np.float64)
        self.kinematics = Kinematics.read(files.urdf, self.rest_posture)
        # The first call compiles; later ones take well below a millisecond.
        self.joints_for(tool_pose(self.kinematics, self.rest_posture), self.rest_posture)

    def reading(self, joints: Array, aperture: float) -> Reading:
        """A reading from measured joint angles, rad, [7], and opening, m."""
        return Reading(tool_pose(self.kinematics, joints), float(aperture))

    def joints_for(self, base_from_tool: Array, now: Array) -> Array | None:
        """Find joint angles that bring the tool to a pose; None if there are none.

        Args:
            base_from_tool: Wanted pose of the tool, m. [4, 4].
            now: Joint angles of the last command, rad. [7].
        """
        found = self.kinematics.inverse(base_from_tool, now)
        return found.q if found.converged else None


def tool_pose(kinematics: Kinematics, joints: Array) -> Array:
    """`base_from_tool` of joint angles, rad. [7] or [8] -> [4, 4]."""
    return kinematics.fk(joints, [kinematics.tip])[kinematics.tip]


class Clock(Protocol):
    """Time of the control loop; a simulated world brings its own."""

    def now(self) -> float:
        """Seconds since some fixed moment."""

    def wait_until(self, moment: float) -> None:
        """Return when `now` has reached a moment; at once if it has passed."""


class WallClock:
    """Real time, not affected by changes of the system's clock."""

    def now(self) -> float:
        """See `Clock`."""
        return time.monotonic()

    def wait_until(self, moment: float) -> None:
        """See `Clock`."""
        left = moment - time.monotonic()
        if left > 0:
            time.sleep(left)


def load_driver(name: str, options: Mapping[str, Any]) -> RobotDriver:
    """Make a driver of the user's own.

    Args:
        name: `module:Class`; the module may lie in the working directory.
        options: Arguments of the class.

    Raises:
        InputError: The class cannot be imported or made, or the driver lacks a method.
    """
    module, _, attribute = name.partition(":")
    if not (module and attribute):
        raise InputError("driver", f"'{name}' names no class", "Give sim, mirror or module:Class, such as my_arm:MyArm")
    sys.path.insert(0, os.getcwd())
    try:
        with _blaming(f"'{name}' cannot be imported", "Check the name, install the module, or mend it"):
            kind = getattr(importlib.import_module(module), attribute)
    finally:
        sys.path.remove(os.getcwd())
    with _blaming(f"'{name}' cannot be made", "Switch the arm on, give what it needs as --option NAME=VALUE, or mend it"):
        driver = kind(**options)
    missing = [part for part in ("rest", "measure", "image", "command", "stop") if not callable(getattr(driver, part, None))]
    if not hasattr(driver, "camera"):
        missing.insert(0, "camera")
    if missing:
        raise InputError("driver", f"'{name}' lacks {', '.join(missing)}", "See RobotDriver in docs/deployment.md")
    camera = driver.camera
    problem = "it is no Camera" if camera is not None and not isinstance(camera, Camera) else camera and camera_problem(camera)
    if problem:
        raise InputError("driver: camera", f"there is no such camera: {problem}", "Give gsbridge.cameras.Camera, or None")
    return driver


@contextlib.contextmanager
def _blaming(problem: str, remedy: str) -> Iterator[None]:
    """Turn an error of the user's driver into a one-line error that names the driver's line in which it was raised.

    Args:
        problem: What is wrong.
        remedy: What the user can do.

    Raises:
        InputError: Something other than a `GsbridgeError` was raised inside.
    """
    try:
        yield
    except GsbridgeError:
        raise
    # A driver must not end the program, either.
    except (Exception, SystemExit) as error:
        ours = (__file__, importlib.__file__, "<frozen")
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith(ours)]
        place = f", in {Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else ""
        said = " ".join(str(error).split())[:300]
        raise InputError("driver", f"{problem} ({type(error).__name__}: {said}{place})", remedy) from error
