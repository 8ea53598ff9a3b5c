"""A robot built once for the tests that need one."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from gsbridge.robot.assembly import RobotFiles, build_robot
from gsbridge.robot.kinematics import Kinematics

_FOLDER = TemporaryDirectory(prefix="gsbridge-robot-")


@cache
def robot() -> RobotFiles:
    """The nominal robot."""
    return build_robot(Path(_FOLDER.name) / "robot")


@cache
def kinematics() -> Kinematics:
    """Its kinematics."""
    return Kinematics.read(robot().urdf)
