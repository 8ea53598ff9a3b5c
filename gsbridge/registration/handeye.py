"""Start value of the registration: hand-eye calibration in closed form, made robust against single wrong poses."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gsbridge.geometry import Array, rotation_angle

_SUBSET, _ROUNDS = 5, 40
_LEVER_M = 0.1
"""Lever arm, m, roughly half the board's size: an angle counts as the distance that a point at this radius moves."""


@dataclass(frozen=True)
class HandEye:
    """Result of a hand-eye calibration.

    Args:
        flange_from_camera: Pose of the camera, OpenCV axes, m. [4, 4].
        base_from_board: Pose of the board, m. [4, 4].
        scale: True size of the board over its assumed size.
    """

    flange_from_camera: Array
    base_from_board: Array
    scale: float = 1.0

    def board_poses(self, base_from_flange: Array, cam_from_board: Array) -> Array:
        """Return `base_from_board` as each pose's own photo gives it. [N, 4, 4], [N, 4, 4] -> [N, 4, 4]."""
        seen = np.array(cam_from_board, dtype=np.float64)
        seen[:, :3, 3] *= self.scale
        return base_from_flange @ self.flange_from_camera @ seen

    def mismatch(self, base_from_flange: Array, cam_from_board: Array) -> Array:
        """Return how far the board as each pose sees it lies from `base_from_board`, angle included, m. [N]."""
        seen = self.board_poses(base_from_flange, cam_from_board)
        shift = np.linalg.norm(seen[:, :3, 3] - self.base_from_board[:3, 3], axis=1)
        return shift + _LEVER_M * rotation_angle(seen[:, :3, :3].transpose(0, 2, 1) @ self.base_from_board[:3, :3])


def turn_spread_deg(base_from_flange: Array) -> Array:
    """Standard deviations of the hand's orientation about its three principal axes, largest first. [N, 4, 4] -> [3].

    Hand-eye calibration needs turns about two axes: with turns about only one, the camera's position along that axis is
    undetermined.
    """
    rotations = np.asarray(base_from_flange)[:, :3, :3]
    u, _, vt = np.linalg.svd(rotations.mean(0))
    mean = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    vectors = np.array([cv2.Rodrigues(np.ascontiguousarray(mean.T @ rotation))[0].ravel() for rotation in rotations])
    centred = vectors - vectors.mean(0)
    return np.rad2deg(np.sqrt(np.maximum(np.linalg.eigvalsh(centred.T @ centred / len(centred))[::-1], 0.0)))


def start_hand_eye(base_from_flange: Array, cam_from_board: Array, *, with_scale: bool, seed: int) -> HandEye:
    """Calibrate from all poses and from many small subsets, and keep the result with the lowest median mismatch.

    Args:
        base_from_flange: Pose of the flange at each photo, m. [N, 4, 4].
        cam_from_board: Pose of the board in each photo, at its assumed size, m. [N, 4, 4].
        with_scale: Whether the board's size is found, too.
        seed: Seed for drawing the subsets.

    Raises:
        ValueError: There are fewer than three poses, or the poses do not determine a calibration.
    """
    count = len(base_from_flange)
    if count < 3:
        raise ValueError("hand-eye calibration needs three poses at least")
    rng = np.random.default_rng(seed)
    sets = [np.arange(count)]
    if count > _SUBSET:
        sets += [np.sort(rng.choice(count, _SUBSET, replace=False)) for _ in range(_ROUNDS)]
    found = (closed_form(base_from_flange[pick], cam_from_board[pick], with_scale=with_scale) for pick in sets)
    usable = [item for item in found if item is not None]
    if not usable:
        raise ValueError("the poses determine no hand-eye calibration")
    # The median over all poses discards subsets that contain a wrong pose, and subsets that are ill conditioned.
    return min(usable, key=lambda item: float(np.median(item.mismatch(base_from_flange, cam_from_board))))


def closed_form(base_from_flange: Array, cam_from_board: Array, *, with_scale: bool) -> HandEye | None:
    """Calibrate in closed form: rotations by the Kronecker product, then translations (and scale) by linear least squares.

    Args:
        base_from_flange: Pose of the flange at each photo. [N, 4, 4].
        cam_from_board: Pose of the board in each photo, at its assumed size. [N, 4, 4].
        with_scale: Whether the board's size is found, too.

    Returns:
        The calibration; None where the poses do not determine it.

    Source: Shah, J. Mechanisms Robotics 5(3), 2013; OpenCV's `calibrateRobotWorldHandEye` is the same method, but version 5
    has no Python binding for it, and none of its methods finds the scale.
    """
    count, turns, seen_turns = len(base_from_flange), base_from_flange[:, :3, :3], cam_from_board[:, :3, :3]
    # flange camera_turn seen = board_turn, rows stacked: (flange x seen^T) vec(camera_turn) - vec(board_turn) = 0.
    products = np.einsum("nij,nkl->niljk", turns, seen_turns).reshape(count, 9, 9)
    system = np.concatenate([products, np.tile(-np.eye(9), (count, 1, 1))], axis=2).reshape(9 * count, 18)
    _, singular, vt = np.linalg.svd(system, full_matrices=False)
    # A null space of two dimensions means that the answer is not unique: the hand turned about one axis only.
    if len(singular) < 18 or singular[-2] < 1e-6 * singular[0]:
        return None
    null = vt[-1] * np.sign(np.linalg.det(vt[-1, :9].reshape(3, 3)))
    camera_turn, board_turn = (_nearest_rotation(part.reshape(3, 3)) for part in (null[:9], null[9:]))
    if camera_turn is None or board_turn is None:
        return None
    # base_from_flange (camera_turn scale seen + camera) = board, for the board's origin in every photo.
    seen = np.einsum("nij,jk,nk->ni", turns, camera_turn, cam_from_board[:, :3, 3])
    known = -base_from_flange[:, :3, 3]
    columns = [turns, np.tile(-np.eye(3), (len(turns), 1, 1))]
    if with_scale:
        columns.append(seen[..., None])
    else:
        known = known - seen
    system = np.concatenate(columns, axis=2).reshape(3 * len(turns), -1)
    solution, _, rank, _ = np.linalg.lstsq(system, known.ravel(), rcond=1e-6)
    scale = float(solution[6]) if with_scale else 1.0
    if rank < system.shape[1] or scale <= 0:
        return None
    out = HandEye(np.eye(4), np.eye(4), scale)
    out.flange_from_camera[:3, :3], out.flange_from_camera[:3, 3] = camera_turn, solution[:3]
    out.base_from_board[:3, :3], out.base_from_board[:3, 3] = board_turn, solution[3:6]
    return out


def _nearest_rotation(matrix: Array) -> Array | None:
    """Return the rotation nearest to a matrix; None if the matrix is not finite or its rank is below two. [3, 3]."""
    if not np.isfinite(matrix).all():
        return None
    u, singular, vt = np.linalg.svd(matrix)
    if singular[1] < 1e-3 * max(singular[0], 1e-12):
        return None
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
