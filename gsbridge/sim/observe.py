"""Kernels that turn the engine's reports into the content of a state; each is called once per control step."""

from __future__ import annotations

import math

import numpy as np

from gsbridge.geometry import Array
from gsbridge.kernels import njit


@njit(nogil=True)
def quat_of(pose: Array, out: Array) -> None:
    """Unit quaternion (wxyz, w >= 0) of a pose's rotation. [4, 4] -> out [4].

    Source: Shepperd, J. Guidance and Control 1(3), 1978: the largest component first, so no small divisor occurs.
    """
    x, y, z = pose[0, 0], pose[1, 1], pose[2, 2]
    squares = (1.0 + x + y + z, 1.0 + x - y - z, 1.0 - x + y - z, 1.0 - x - y + z)
    largest = 0
    for k in range(1, 4):
        if squares[k] > squares[largest]:
            largest = k
    skew = (pose[2, 1] - pose[1, 2], pose[0, 2] - pose[2, 0], pose[1, 0] - pose[0, 1])
    even = (pose[2, 1] + pose[1, 2], pose[0, 2] + pose[2, 0], pose[1, 0] + pose[0, 1])
    if largest == 0:
        out[0], out[1], out[2], out[3] = squares[0], skew[0], skew[1], skew[2]
    elif largest == 1:
        out[0], out[1], out[2], out[3] = skew[0], squares[1], even[2], even[1]
    elif largest == 2:
        out[0], out[1], out[2], out[3] = skew[1], even[2], squares[2], even[0]
    else:
        out[0], out[1], out[2], out[3] = skew[2], even[1], even[0], squares[3]
    length = 0.0
    for k in range(4):
        length += out[k] * out[k]
    length = math.copysign(math.sqrt(length), out[0])
    for k in range(4):
        out[k] /= length


@njit(nogil=True)
def object_state(motion: Array, inertial_from_body: Array, points: Array, pose: Array, velocity: Array) -> float:
    """Pose and velocity of an object's body frame, and the height of its lowest point.

    Args:
        motion: Position (3, m) and quaternion xyzw (4) of the inertial frame, velocity (3, m/s) of the centre of mass, angular
            velocity (3, rad/s). [13].
        inertial_from_body: Fixed pose of the body frame in the inertial frame. [4, 4].
        points: Vertices of its hull, body frame, m. [P, 3].
        pose: Result, `table_from_body`. [4, 4].
        velocity: Result: velocity of the body's origin, m/s. [3].

    Returns:
        Height of the lowest vertex over the table, m.
    """
    x, y, z, w = motion[3], motion[4], motion[5], motion[6]
    turn = np.empty((3, 3))
    turn[0, 0], turn[0, 1], turn[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    turn[1, 0], turn[1, 1], turn[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    turn[2, 0], turn[2, 1], turn[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    for i in range(3):
        for j in range(4):
            pose[i, j] = motion[i] if j == 3 else 0.0
            for k in range(3):
                pose[i, j] += turn[i, k] * inertial_from_body[k, j]
        pose[3, i] = 0.0
    pose[3, 3] = 1.0
    dx, dy, dz = pose[0, 3] - motion[0], pose[1, 3] - motion[1], pose[2, 3] - motion[2]
    velocity[0] = motion[7] + motion[11] * dz - motion[12] * dy
    velocity[1] = motion[8] + motion[12] * dx - motion[10] * dz
    velocity[2] = motion[9] + motion[10] * dy - motion[11] * dx
    lowest = np.inf
    for k in range(len(points)):
        height = pose[2, 3]
        for j in range(3):
            height += pose[2, j] * points[k, j]
        if not height >= lowest:  # written so that a NaN is kept
            lowest = height
    return lowest


@njit(nogil=True)
def state_row(
    tool: Array, aperture: float, forces: Array, item: Array, velocity: Array, spin: Array, clearance: float, out: Array
) -> None:
    """All numbers of a `gsbridge.tasks.state.State`, in the order of its fields.

    Args:
        tool, item: `table_from_tool`, `table_from_object`, m. [4, 4].
        aperture: Opening of the gripper, m.
        forces: Left pad, right pad, robot, object, N. [4].
        velocity, spin: Velocity, m/s, and angular velocity, rad/s, of the object's body frame. [3].
        clearance: Height of the object's lowest vertex over the table, m.
        out: Result. [26].
    """
    for i in range(3):
        out[i], out[10 + i], out[17 + i], out[20 + i] = tool[i, 3], item[i, 3], velocity[i], spin[i]
    quat_of(tool, out[3:7])
    quat_of(item, out[13:17])
    out[7], out[8], out[9] = aperture, forces[0], forces[1]
    out[23], out[24], out[25] = clearance, forces[2], forces[3]


@njit(nogil=True)
def rigid_inverse(pose: Array, out: Array) -> None:
    """`b_from_a` of a rigid `a_from_b`. [4, 4] -> out [4, 4]."""
    for i in range(3):
        out[i, 3] = 0.0
        for j in range(3):
            out[i, j] = pose[j, i]
            out[i, 3] -= pose[j, i] * pose[j, 3]
        out[3, i] = 0.0
    out[3, 3] = 1.0
