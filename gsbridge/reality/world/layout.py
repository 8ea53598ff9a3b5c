"""True poses of the mirror's table and camera: the nominal layout, changed by hidden parameters.

Code outside the mirror learns these poses only through `registration.json`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gsbridge.geometry import Array
from gsbridge.reality.world.hidden import Hidden
from gsbridge.robot import nominal
from gsbridge.robot.assembly import RobotFiles, build_robot


def true_base_from_table(hidden: Hidden) -> Array:
    """Return the table's true pose: the nominal one shifted along the base's axes, turned about the board's centre. [4, 4]."""
    return _moved(nominal.base_from_table(), hidden.table_shift, hidden.table_turn)


def true_flange_from_camera(hidden: Hidden) -> Array:
    """Return the camera's true pose: the nominal one shifted along the flange's axes, turned about its own centre. [4, 4]."""
    return _moved(nominal.flange_from_camera(), hidden.camera_shift, hidden.camera_turn)


def true_robot(folder: str | Path, hidden: Hidden) -> RobotFiles:
    """Write the mirror's robot, with the true pose of its camera, to `folder`; for `build_mirror`."""
    return build_robot(folder, flange_from_camera=true_flange_from_camera(hidden))


def _moved(pose: Array, shift: tuple[float, ...], turn: tuple[float, ...]) -> Array:
    """Shift a pose, m, and turn it by a rotation vector, rad, both along the outer frame's axes. [4, 4]."""
    out = np.array(pose)
    out[:3, 3] += shift
    out[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ out[:3, :3]
    return out
