"""Compiled kernels of the kinematics for the control loop: poses of all links, the tool's Jacobian, damped least squares.

A robot is a list of nodes with parents first. Node `k` hangs below `parents[k]` (-1: the base) by the transform `fixed[k]` and
turns by `values[k]` about `axes[k]` (a zero axis for a fixed joint).
"""

from __future__ import annotations

import math

import numpy as np

from gsbridge.geometry import Array
from gsbridge.kernels import njit

_LENGTH = 0.3
"""Length, m, that weighs as much as one radian: about the lever arm of the wrist, so that both errors shrink together."""

_MAX_STEP = 0.25
"""Largest joint step of one iteration, rad: the linear model is useless beyond it."""

_POSTURE_GAIN = 0.5
"""Share of the distance to the rest posture covered per iteration, in the directions that do not move the tool."""


@njit(nogil=True)
def place_links(parents: Array, fixed: Array, axes: Array, values: Array, out: Array) -> None:
    """Compute the poses of all nodes in the base frame.

    Args:
        parents: Index of each node's parent node, -1 for the base. [K] int.
        fixed: parent_from_node of each node with its joint at zero. [K, 4, 4].
        axes: Unit axis of each joint in its node's frame, zero for a fixed joint. [K, 3].
        values: Angle of each joint, rad. [K].
        out: Result, base_from_node. [K, 4, 4].
    """
    for k in range(len(parents)):
        x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        for i in range(3):
            for j in range(4):
                out[k, i, j] = fixed[k, i, j]
            out[k, 3, i] = 0.0
        out[k, 3, 3] = 1.0
        if x != 0.0 or y != 0.0 or z != 0.0:
            # Multiply by Rodrigues' rotation matrix, column by column.
            sine, cosine = math.sin(values[k]), math.cos(values[k])
            rest = 1.0 - cosine
            for i in range(3):
                a, b, c = fixed[k, i, 0], fixed[k, i, 1], fixed[k, i, 2]
                out[k, i, 0] = a * (cosine + x * x * rest) + b * (y * x * rest + z * sine) + c * (z * x * rest - y * sine)
                out[k, i, 1] = a * (x * y * rest - z * sine) + b * (cosine + y * y * rest) + c * (z * y * rest + x * sine)
                out[k, i, 2] = a * (x * z * rest + y * sine) + b * (y * z * rest - x * sine) + c * (cosine + z * z * rest)
        parent = parents[k]
        if parent >= 0:
            for j in range(4):
                a, b, c = out[k, 0, j], out[k, 1, j], out[k, 2, j]
                for i in range(3):
                    value = out[parent, i, 0] * a + out[parent, i, 1] * b + out[parent, i, 2] * c
                    out[k, i, j] = value + out[parent, i, 3] if j == 3 else value


@njit(nogil=True)
def offset(target: Array, current: Array, out: Array) -> float:
    """Compute the vector from the current position to the target position.

    Args:
        target, current: Poses in one frame, m. [4, 4] each.
        out: The first three elements receive the result, m. [3] or longer.

    Returns:
        Length of the vector, m.
    """
    total = 0.0
    for i in range(3):
        out[i] = target[i, 3] - current[i, 3]
        total += out[i] * out[i]
    return math.sqrt(total)


@njit(nogil=True)
def rotation_error(target: Array, current: Array, out: Array) -> float:
    """Compute the rotation vector, in the base frame, that turns `current` into `target`.

    Args:
        target, current: Poses in the base frame; only their rotations count. [4, 4] each.
        out: Result, rad. [3].

    Returns:
        Angle of the rotation, rad.
    """
    delta = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                delta[i, j] += target[i, k] * current[j, k]
    x, y, z = delta[2, 1] - delta[1, 2], delta[0, 2] - delta[2, 0], delta[1, 0] - delta[0, 1]
    double_sine = math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(double_sine, delta[0, 0] + delta[1, 1] + delta[2, 2] - 1.0)
    if double_sine > 1e-9:
        scale = angle / double_sine
    elif angle < 1.0:
        scale = 0.5
    else:
        # Half a turn: the axis is the largest column of delta + identity; either direction of turning is right.
        axis = 0
        for k in range(1, 3):
            if delta[k, k] > delta[axis, axis]:
                axis = k
        x, y, z = delta[0, axis], delta[1, axis], delta[2, axis]
        if axis == 0:
            x += 1.0
        elif axis == 1:
            y += 1.0
        else:
            z += 1.0
        scale = angle / math.sqrt(x * x + y * y + z * z)
    out[0], out[1], out[2] = scale * x, scale * y, scale * z
    return angle


@njit(nogil=True)
def cholesky_solve(matrix: Array, right: Array) -> None:
    """Solve a small symmetric positive definite system in place. matrix [N, N] (lower half used), right [N, M]."""
    size = len(matrix)
    for j in range(size):
        for k in range(j):
            matrix[j, j] -= matrix[j, k] * matrix[j, k]
        matrix[j, j] = math.sqrt(max(matrix[j, j], 1e-300))
        for i in range(j + 1, size):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
            matrix[i, j] /= matrix[j, j]
    for m in range(right.shape[1]):
        for i in range(size):
            for k in range(i):
                right[i, m] -= matrix[i, k] * right[k, m]
            right[i, m] /= matrix[i, i]
        for i in range(size - 1, -1, -1):
            for k in range(i + 1, size):
                right[i, m] -= matrix[k, i] * right[k, m]
            right[i, m] /= matrix[i, i]


@njit(nogil=True)
def place_tool_down(base_from_frame: Array, x: float, y: float, z: float, yaw: float, out: Array) -> None:
    """Compute the pose of a tool that points down: `base_from_frame @ gsbridge.robot.reach.tool_down((x, y, z), yaw)`.

    Args:
        base_from_frame: Pose of the frame in which the target is given. [4, 4].
        x, y, z: Position of the tool in that frame, m.
        yaw: Turn about the frame's z, rad.
        out: Result, base_from_tool. [4, 4].
    """
    cosine, sine = math.cos(yaw), math.sin(yaw)
    for i in range(4):
        a, b, c = base_from_frame[i, 0], base_from_frame[i, 1], base_from_frame[i, 2]
        out[i, 0], out[i, 1], out[i, 2] = a * cosine + b * sine, a * sine - b * cosine, -c
        out[i, 3] = a * x + b * y + c * z + base_from_frame[i, 3]


@njit(nogil=True)
def tool_jacobian(axes: Array, nodes: Array, poses: Array, tool: int, out: Array) -> None:
    """Compute the geometric Jacobian of one node in the base frame.

    Args:
        axes: Unit axis of each joint in its node's frame. [K, 3].
        nodes: Node indices of the N joints on the path from the base to the tool. [N] int.
        poses: base_from_node of all nodes, from `place_links`. [K, 4, 4].
        tool: Index of the node whose Jacobian is computed.
        out: Result: three rows in m per rad, then three in rad per rad. [6, N].
    """
    for column in range(len(nodes)):
        k = nodes[column]
        x = poses[k, 0, 0] * axes[k, 0] + poses[k, 0, 1] * axes[k, 1] + poses[k, 0, 2] * axes[k, 2]
        y = poses[k, 1, 0] * axes[k, 0] + poses[k, 1, 1] * axes[k, 1] + poses[k, 1, 2] * axes[k, 2]
        z = poses[k, 2, 0] * axes[k, 0] + poses[k, 2, 1] * axes[k, 1] + poses[k, 2, 2] * axes[k, 2]
        dx, dy, dz = poses[tool, 0, 3] - poses[k, 0, 3], poses[tool, 1, 3] - poses[k, 1, 3], poses[tool, 2, 3] - poses[k, 2, 3]
        out[0, column] = y * dz - z * dy
        out[1, column] = z * dx - x * dz
        out[2, column] = x * dy - y * dx
        out[3, column], out[4, column], out[5, column] = x, y, z


@njit(nogil=True)
def damped_step(jacobian: Array, error: Array, pull: Array, free: Array, damping: float, step: Array) -> None:
    """Compute one joint step: damped least squares towards the target, plus the part of `pull` that does not move the tool.

    Args:
        jacobian: Jacobian with its angular rows weighted, m per rad. [6, N].
        error: Pose error with its angular part weighted alike, m. [6].
        pull: Joint motion towards the rest posture, rad; only its part in the null space of the Jacobian is used. [N].
        free: Joints that may move. [N] bool.
        damping: Value added to the diagonal of J J^T, m2.
        step: Result, rad. [N].
    """
    count = jacobian.shape[1]
    normal, right = np.zeros((6, 6)), np.zeros((6, 2))
    for i in range(6):
        right[i, 0] = error[i]
        normal[i, i] = damping
        for k in range(count):
            if free[k]:
                right[i, 1] += jacobian[i, k] * pull[k]
                for j in range(i + 1):
                    normal[i, j] += jacobian[i, k] * jacobian[j, k]
    cholesky_solve(normal, right)
    for k in range(count):
        step[k] = 0.0
        if free[k]:
            step[k] = pull[k]
            for i in range(6):
                step[k] += jacobian[i, k] * (right[i, 0] - right[i, 1])


@njit(nogil=True)
def solve_inverse(
    parents: Array,
    fixed: Array,
    axes: Array,
    nodes: Array,
    tool: int,
    target: Array,
    rest: Array,
    pull_weights: Array,
    lower: Array,
    upper: Array,
    tolerance: float,
    iterations: int,
    q: Array,
) -> tuple[float, float, int]:
    """Solve inverse kinematics by damped least squares within joint limits.

    Args:
        parents, fixed, axes: The chain of nodes, as in `place_links`. [K], [K, 4, 4], [K, 3].
        nodes: Node indices of the N joints that may move. [N] int.
        tool: Index of the node that shall reach the target.
        target: Wanted pose of the tool, base frame. [4, 4].
        rest: Posture that is preferred where the target leaves a choice, rad. [N].
        pull_weights: How strongly each joint is drawn to the rest posture. [N].
        lower, upper: Limits of the joints, rad. [N] each.
        tolerance: Error below which a solution counts as reached, m (and rad times 0.3 m).
        iterations: Largest number of iterations.
        q: Start, which is cut to the limits; it is overwritten by the solution, rad. [N].

    Returns:
        Position error m, angle error rad, number of iterations. The iteration ends when both errors lie within `tolerance` and
        the posture no longer moves, so that the answer hardly depends on the start.
    """
    count = len(q)
    values, poses = np.zeros(len(parents)), np.empty((len(parents), 4, 4))
    jacobian, error, step = np.empty((6, count)), np.empty(6), np.empty(count)
    pull, free, turn = np.empty(count), np.empty(count, np.bool_), np.empty(3)
    for k in range(count):
        q[k] = min(max(q[k], lower[k]), upper[k])
    best = q.copy()
    best_error = np.inf
    position, angle, done = np.inf, np.inf, 0
    for round_ in range(iterations + 1):
        for k in range(count):
            values[nodes[k]] = q[k]
        place_links(parents, fixed, axes, values, poses)
        angle = rotation_error(target, poses[tool], turn)
        position = offset(target, poses[tool], error)
        for i in range(3):
            error[3 + i] = _LENGTH * turn[i]
        total = position * position + (_LENGTH * angle) ** 2
        reached = max(position, _LENGTH * angle) <= tolerance
        if total < best_error or reached:
            best_error = total
            best[:] = q
        done = round_
        if round_ == iterations:
            break
        tool_jacobian(axes, nodes, poses, tool, jacobian)
        for k in range(count):
            free[k] = True
            pull[k] = _POSTURE_GAIN * pull_weights[k] * (rest[k] - q[k])
            for i in range(3, 6):
                jacobian[i, k] *= _LENGTH
        # Damping in proportion to the squared error (Sugihara): fast convergence near the target, and small steps where the
        # target cannot be reached.
        damping = 0.05 * total + 1e-10
        for _ in range(count):
            damped_step(jacobian, error, pull, free, damping, step)
            blocked = False
            for k in range(count):
                if free[k] and ((q[k] <= lower[k] and step[k] < 0.0) or (q[k] >= upper[k] and step[k] > 0.0)):
                    free[k] = False
                    blocked = True
            if not blocked:
                break
        largest = 0.0
        for k in range(count):
            largest = max(largest, abs(step[k]))
        if reached and largest < 10.0 * tolerance:
            break
        shrink = min(1.0, _MAX_STEP / max(largest, 1e-300))
        for k in range(count):
            q[k] = min(max(q[k] + shrink * step[k], lower[k]), upper[k])
    q[:] = best
    for k in range(count):
        values[nodes[k]] = q[k]
    place_links(parents, fixed, axes, values, poses)
    angle = rotation_error(target, poses[tool], turn)
    return offset(target, poses[tool], error), angle, done
