"""Nominal poses of the robot, its camera and the table, which serve as defaults until a registration exists."""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array
from gsbridge.robot.links import translation

REST_POSTURE = (0.0, 0.763, 0.0, -1.493, 0.0, 0.886, 0.0)
"""Arm joints, rad, with the tool pointing down, 0.25 m above the middle of the nominal working area, and the elbow up. [7]."""


def flange_from_gripper() -> Array:
    """Return the pose of the gripper on the flange: half a turn about the flange's axis. [4, 4].

    With the elbow up and the last joint at zero, the x axis of the iiwa's flange points back to the base. The half turn puts
    the camera on the far side, as in the paper, and leaves the last joint its whole range: without it, yaw 0 would be at the
    joint's limit.
    """
    return np.diag([-1.0, -1.0, 1.0, 1.0])


WORK_CENTRE = (0.0, 0.265)
"""Middle of the 30 x 30 cm working area in the table frame, m: the board, the frame's origin, lies beside it."""


def base_from_table(centre: tuple[float, float] = WORK_CENTRE) -> Array:
    """Return the table's nominal pose: the working area's middle 0.60 m before the robot and 0.18 m below its foot. [4, 4].

    The robot stands on the table's -x side and looks along +x, so that the board lies to its right.

    The elbow's limit keeps the wrist at least 0.41 m from the shoulder, the arm's length keeps it within 0.82 m, and the hand
    is 0.34 m long. With the foot 0.18 m above the table top, the wrist works at the height of the shoulder, where the gap
    between these two spheres is widest. A square of 0.34 m at heights of 35 mm to 350 mm is then within reach with 3 degrees to
    spare on every joint, and the start region of 0.30 m with 6 degrees.

    Args:
        centre: Middle of the working area, table frame, m.
    """
    return translation(0.60 - centre[0], -centre[1], -0.18)


def flange_from_camera(forward: float = 0.085, height: float = 0.020, tilt: float = np.deg2rad(12.0)) -> Array:
    """Return the wrist camera's nominal pose: beside the gripper, looking along it and tilted towards the tool.

    Args:
        forward: Distance of the optical centre from the flange's axis along the gripper's +x, m.
        height: Height of the camera over the flange face towards the tool, m.
        tilt: Angle of the optical axis towards the tool, rad.

    Returns:
        Camera frame with OpenCV axes (x right, y down, z forward); up in the image is the gripper's +x. [4, 4].
    """
    out = translation(forward, 0.0, height)
    forward_axis = np.array([-np.sin(tilt), 0.0, np.cos(tilt)])
    right_axis = np.array([0.0, 1.0, 0.0])
    out[:3, :3] = np.stack([right_axis, np.cross(forward_axis, right_axis), forward_axis], axis=1)
    return flange_from_gripper() @ out
