"""Compilation of the kinematics kernels ahead of time, so that parallel jobs find them in the cache."""

from __future__ import annotations

import numpy as np

from gsbridge.robot.kinematics import Kinematics
from gsbridge.robot.links import Joint, translation
from gsbridge.robot.urdf import Tree


def compile_kernels() -> None:
    """Solve a two-link arm; numba compiles and caches every kernel on the way."""
    link = translation(0.3, 0.0, 0.0)
    joints = (
        Joint("shoulder", "base", "upper", np.eye(4), "revolute", (0.0, 0.0, 1.0), -3.0, 3.0, 1.0, 1.0),
        Joint("elbow", "upper", "lower", link, "revolute", (0.0, 0.0, 1.0), -3.0, 3.0, 1.0, 1.0),
        Joint("hand", "lower", "tool", link),
    )
    arm = Kinematics(Tree("base", joints), np.array([0.1, 0.2]))
    bent = np.array([0.3, 0.4])
    arm.jacobian(bent)
    arm.inverse(arm.fk(bent, ["tool"])["tool"])
