"""Compiling the kernels of the simulated world once, so that jobs side by side find them in the cache."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gsbridge.robot.assembly import build_robot
from gsbridge.robot.kinematics import Kinematics
from gsbridge.sim.controller import Controller
from gsbridge.sim.model import Model
from gsbridge.sim.observe import object_state, quat_of, rigid_inverse


def compile_kernels(model: Model) -> None:
    """Take one step of control and one look, without an engine; numba compiles and caches every kernel on the way."""
    with TemporaryDirectory() as folder:
        robot = build_robot(Path(folder) / "robot")
        controller = Controller(robot, Kinematics.read(robot.urdf), model, np.array([0.0, 0.0, -model.gravity]))
    measured = np.zeros((2, len(controller.goal)))
    controller.begin_period(controller.dimensions.stroke)
    controller.substep(0, measured)
    pose, out = controller.place_links(measured, np.eye(4))[0], np.empty((4, 4))
    rigid_inverse(pose, out)
    quat_of(pose, np.empty(4))
    motion = np.zeros(13)
    motion[6] = 1.0
    object_state(motion, np.eye(4), np.zeros((1, 3)), out, np.empty(3))
