"""Compilation of the simulated world's kernels in advance, so that parallel jobs find them in the cache."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gsbridge.robot.assembly import build_robot
from gsbridge.robot.chain import place_tool_down
from gsbridge.robot.kinematics import Kinematics
from gsbridge.sim.controller import Controller
from gsbridge.sim.model import Model
from gsbridge.sim.observe import object_state, rigid_inverse, state_row
from gsbridge.tasks import grasp, place
from gsbridge.tasks.outcome import Progress
from gsbridge.tasks.state import ROW, State


def compile_kernels(model: Model) -> None:
    """Take one step, one look and one judgement, without an engine; numba compiles and caches every kernel on the way."""
    with TemporaryDirectory() as folder:
        robot = build_robot(Path(folder) / "robot")
        controller = Controller(robot, Kinematics.read(robot.urdf), model, np.array([0.0, 0.0, -model.gravity]))
    measured = np.zeros((2, len(controller.goal)))
    controller.begin_period(controller.dimensions.stroke)
    controller.substep(0, measured)
    pose, out = controller.place_links(measured, np.eye(4))[0], np.empty((4, 4))
    rigid_inverse(pose, out)
    place_tool_down(np.eye(4), 0.0, 0.0, 0.0, 0.0, out)
    motion, velocity, row = np.zeros(13), np.zeros(3), np.empty(ROW)
    motion[6] = 1.0
    clearance = object_state(motion, np.eye(4), np.zeros((1, 3)), out, velocity)
    state_row(pose, 0.1, np.zeros(4), out, velocity, motion[10:], clearance, row)
    state = State.of_row(row)
    grasp.judge(state, Progress.start(1), grasp.Grasp())
    place.judge(state, Progress.start(1), place.Place((0.0, 0.3)))
