"""Planning of arm poses from which the wrist camera sees the board well, spread over sides, tilts, distances and turns."""

from __future__ import annotations

import numpy as np

from gsbridge.cameras import Camera, look_at
from gsbridge.errors import StageError
from gsbridge.geometry import Array, rotation_angle
from gsbridge.photogrammetry.board import Board
from gsbridge.robot.kinematics import Kinematics

_TILT = (np.deg2rad(8.0), np.deg2rad(40.0))
"""Range of the angle between line of sight and vertical, rad. At larger angles, far tags look too narrow to measure well."""

_DISTANCE_M = (0.38, 0.58)
_AIM_M = 0.02
_NOD = (np.deg2rad(0.0), np.deg2rad(8.0))
"""Range of the angle, rad, by which the camera aims below the board's middle: it moves the board up in the picture, away from
the hand."""

_MARGIN_PX = 14.0
"""Room between the board's outermost tag and the picture's border, px: the camera's true pose differs from the assumed one."""

_LIMIT_MARGIN = np.deg2rad(4.0)
_CLEARANCE_M = 0.045
"""Least height of hand and arm over the table, m: the table's true pose, too, differs from the assumed one."""

_HAND_RADIUS_M = 0.03
_BEYOND_TOOL_M = 0.035
"""The pads reach beyond the tool point by half their length."""

_TAGS_SEEN = 6
_CHOICE = 5
"""Number of usable candidates collected per wanted pose; the ones farthest apart are then taken."""

_TURN_WEIGHT_M = 0.25
"""Distance of the camera, m, that counts as much as a turn of one radian when poses are spread."""


def plan_poses(
    kinematics: Kinematics,
    base_from_table: Array,
    flange_from_camera: Array,
    camera: Camera,
    board: Board,
    *,
    count: int,
    seed: int,
    tries: int = 4000,
) -> Array:
    """Choose arm poses for a board capture.

    Args:
        kinematics: The robot.
        base_from_table: Assumed pose of the table; a few centimetres of error do no harm. [4, 4].
        flange_from_camera: Assumed pose of the camera. [4, 4].
        camera: Intrinsics.
        board: The board, lying at the table frame's origin.
        count: Number of poses wanted.
        seed: Random seed.
        tries: Largest number of candidates to try.

    Returns:
        Arm joints, rad, ordered so that the arm moves little from each pose to the next. [count, J].

    Raises:
        StageError: Fewer poses than wanted see the board, are within the arm's reach and keep clear of the table.
    """
    rng = np.random.default_rng(seed)
    links = kinematics.fk(kinematics.rest, ["flange", "palm", "tool"])
    camera_from_base = np.linalg.inv(links["flange"] @ flange_from_camera)
    camera_from_tool = camera_from_base @ links["tool"]
    hand = _hand((camera_from_base @ links["palm"])[:3, 3], camera_from_tool[:3, 3])
    found: list[Array] = []
    views: list[Array] = []
    for _ in range(tries):
        if len(found) == _CHOICE * count:
            break
        table_from_camera = _candidate(rng)
        # The checks that need no kinematics come first: they are cheap and reject most candidates.
        heights = (table_from_camera[:3, :3] @ hand.T).T[:, 2] + table_from_camera[2, 3]
        if heights.min() < _CLEARANCE_M or not _in_view(camera, np.linalg.inv(table_from_camera), board, hand):
            continue
        answer = kinematics.inverse(base_from_table @ table_from_camera @ camera_from_tool)
        if not answer.converged or kinematics.arm_limits.margin(answer.q).min() < _LIMIT_MARGIN:
            continue
        # The first pose is that of the robot's foot: it does not move, so it needs no clearance.
        arm = np.linalg.inv(base_from_table) @ kinematics.poses(answer.q)[1:]
        if arm[:, 2, 3].min() < _CLEARANCE_M:
            continue
        found.append(answer.q)
        views.append(table_from_camera)
    if len(found) < count:
        raise StageError(
            "board capture",
            f"{len(found)} of {tries} tried poses see the board within the arm's reach, {count} are wanted",
            "Lay the board nearer to 0.6 m in front of the robot, or ask for fewer poses",
        )
    return np.array(found)[_ordered(np.array(found), _spread(np.array(views), count))]


def _hand(palm: Array, tool: Array) -> Array:
    """Return points along the closed hand from the palm to its fingertips, in the frame of `palm` and `tool`, m. [10, 3]."""
    length = float(np.linalg.norm(tool - palm))
    return palm + np.linspace(0.0, length + _BEYOND_TOOL_M, 10)[:, None] * (tool - palm) / length


def _candidate(rng: np.random.Generator) -> Array:
    """Draw a camera pose `table_from_camera` that looks at the board from a random side, tilt, distance and turn. [4, 4]."""
    around, turn = rng.uniform(-np.pi, np.pi, 2)
    tilt, distance, nod = rng.uniform(*_TILT), rng.uniform(*_DISTANCE_M), rng.uniform(*_NOD)
    aim = np.array([*rng.uniform(-_AIM_M, _AIM_M, 2), 0.0])
    level = np.array([np.cos(around), np.sin(around)]) * np.sin(tilt)
    eye = aim + distance * np.array([*level, np.cos(tilt)])
    out = np.linalg.inv(look_at(eye, aim, np.array([np.cos(turn), np.sin(turn), 0.0])))
    c, s = np.cos(nod), np.sin(nod)
    # Turn the line of sight towards the picture's lower border.
    out[:3, :3] = out[:3, :3] @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    return out


def _in_view(camera: Camera, cam_from_table: Array, board: Board, hand: Array) -> bool:
    """Whether all tags lie in the picture and the hand (camera frame) leaves most of them in sight."""
    corners = np.concatenate(list(board.corners().values()))
    pixels = camera.project(corners @ cam_from_table[:3, :3].T + cam_from_table[:3, 3])
    high = np.array([camera.width, camera.height]) - _MARGIN_PX
    if not (np.isfinite(pixels).all() and (pixels > _MARGIN_PX).all() and (pixels < high).all()):
        return False
    rays = np.c_[board.centres, np.zeros(len(board.ids))] @ cam_from_table[:3, :3].T + cam_from_table[:3, 3]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    forth = hand @ rays.T
    aside = np.linalg.norm(hand[:, None] - forth[..., None] * rays, axis=2)
    hidden = ((forth > 0) & (aside < _HAND_RADIUS_M)).any(0)
    return int(np.count_nonzero(~hidden)) >= _TAGS_SEEN


def _spread(views: Array, count: int) -> list[int]:
    """Choose views one after the other, each as far as possible in place and turn from those before. [M, 4, 4] -> indices."""
    chosen = [0]
    near = np.full(len(views), np.inf)
    while len(chosen) < count:
        last = views[chosen[-1]]
        turn = rotation_angle(last[:3, :3].T @ views[:, :3, :3])
        near = np.minimum(near, np.linalg.norm(views[:, :3, 3] - last[:3, 3], axis=1) + _TURN_WEIGHT_M * turn)
        chosen.append(int(np.argmax(near)))
    return chosen


def _ordered(joints: Array, chosen: list[int]) -> list[int]:
    """Order the chosen indices so that after each pose comes the nearest remaining one, by the largest joint difference."""
    left, out = list(chosen[1:]), [chosen[0]]
    while left:
        nearest = min(left, key=lambda index: float(np.abs(joints[index] - joints[out[-1]]).max()))
        left.remove(nearest)
        out.append(nearest)
    return out
