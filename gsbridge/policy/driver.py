"""Interface that users implement for an arm of their own: five methods between the runner and the hardware.

Frames: `base` is the frame of the arm's first link as in the URDF, `tool` lies between the pads' centres when the gripper is
closed, z out of the hand, x to the camera's side, the pads open along y. Metres, radians, `a_from_b`.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from gsbridge.cameras import Camera, given_camera
from gsbridge.errors import GsbridgeError, InputError
from gsbridge.geometry import Array
from gsbridge.robot.assembly import RobotFiles
from gsbridge.robot.kinematics import Kinematics
from gsbridge.tasks.world import CONTROL_HZ

logger = logging.getLogger("gsbridge")


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


_HOLDS = 3
"""Number of times that an arm is told to hold, if it is interrupted meanwhile; the last time, signals are not heeded."""


def hold(driver: RobotDriver) -> None:
    """Stop an arm, and do not let Ctrl-C or an error keep it from that: a frightened person presses more than once.

    Args:
        driver: The arm; its `stop` is called again if it was interrupted or failed.

    Raises:
        KeyboardInterrupt: The user pressed Ctrl-C meanwhile; the arm was stopped all the same.
        Exception: The driver's own, of the last attempt: nobody knows whether the arm holds.
    """
    interrupted: KeyboardInterrupt | None = None
    for left in reversed(range(_HOLDS)):
        try:
            with contextlib.nullcontext() if left else _unheeded():
                driver.stop()
            break
        except KeyboardInterrupt as error:
            interrupted = error
            logger.warning("interrupted while the arm was told to hold: it is told again")
        except Exception as error:
            if not left:
                logger.error("the arm could not be told to hold: use the emergency stop")
                raise
            logger.warning("the driver's stop() failed and is called again: %s: %s", type(error).__name__, error)
    if interrupted is not None:
        raise interrupted


@contextlib.contextmanager
def _unheeded() -> Iterator[None]:
    """Ignore the signals that end a program; Ctrl-\\ still does. Only the main thread can, and only it is interrupted."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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
            now: Joint angles to start the search from, such as those of the last command, rad. [7].
        """
        found = self.kinematics.inverse(base_from_tool, now)
        return found.q if found.converged else None

    def next_joints(self, base_from_tool: Array, now: Array) -> Array | None:
        """Find the joint angles to command for the next control period; None if the tool cannot go to the pose.

        They lie on the way to the pose, as far as the arm's joint speeds allow: all joints slow down by the same factor. If
        each joint were limited on its own, as many arms do, the tool would leave its path, and could go into the table.

        Args:
            base_from_tool: Wanted pose of the tool, m. [4, 4].
            now: Joint angles of the last command, rad. [7].
        """
        wanted = self.joints_for(base_from_tool, now)
        return None if wanted is None else self.kinematics.arm_limits.follow(now, wanted, 1.0 / CONTROL_HZ)


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
    if driver.camera is not None:
        _check_camera(driver.camera)
    return driver


def _check_camera(camera: object) -> None:
    """Refuse a driver's camera that cannot exist.

    Raises:
        InputError: It is no `Camera`, or one of its numbers makes no sense.
    """
    remedy = "Give gsbridge.cameras.Camera, or None"
    if not isinstance(camera, Camera):
        raise InputError("driver: camera", "there is no such camera: it is no Camera", remedy)
    if np.shape(camera.distortion) != (4,):
        problem = f"its distortion {camera.distortion!r} is not four numbers"[:200]
        raise InputError("driver: camera", problem, "Give (k1, k2, p1, p2) of OpenCV; calibrate with k3 fixed at 0")
    given_camera(vars(camera), "driver: camera", remedy)


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
