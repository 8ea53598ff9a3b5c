"""Synthetic board captures with known truth, without pictures: tag corners by projection."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gsbridge.cameras import Camera, look_at
from gsbridge.photogrammetry.board import standard_board
from gsbridge.robot import nominal

CAMERA = Camera(640, 480, 617.0, 615.0, 322.0, 238.0, (0.05, -0.04, 0.001, -0.0005))
BOARD = standard_board()


def shifted(pose, rng, shift, turn):
    """A pose moved by up to `shift` m and `turn` rad along each axis."""
    out = np.array(pose)
    out[:3, 3] += rng.uniform(-shift, shift, 3)
    out[:3, :3] = Rotation.from_rotvec(rng.uniform(-turn, turn, 3)).as_matrix() @ out[:3, :3]
    return out


@dataclass
class Sight:
    """Truth, poses of the flange, and tag corners by photo."""

    flange_from_camera: np.ndarray
    base_from_board: np.ndarray
    base_from_flange: np.ndarray
    tags: list


def table_from_cameras(count, rng, tilt=0.6, turn=np.pi):
    """Cameras round the board; with tilt 0 and a small turn the motion is degenerate. [count, 4, 4]."""
    out = []
    for around in np.linspace(0, 2 * np.pi, count, endpoint=False):
        lean, roll = rng.uniform(0.4 * tilt, tilt), rng.uniform(-turn, turn)
        eye = rng.uniform(0.42, 0.55) * np.array([np.sin(lean) * np.cos(around), np.sin(lean) * np.sin(around), np.cos(lean)])
        out.append(np.linalg.inv(look_at(eye, rng.uniform(-0.01, 0.01, 3), (np.cos(roll), np.sin(roll), 0.0))))
    return np.array(out)


def sight(seed, count=12, noise_px=0.1, scale=1.0, views=None):
    """A capture.

    Args:
        seed: Of places, poses and noise.
        count: Photos.
        noise_px: Standard deviation of the corners.
        scale: True size of the board over the printed one.
        views: `table_from_camera` of the photos; None for well spread ones.
    """
    rng = np.random.default_rng(seed)
    flange_from_camera = shifted(nominal.flange_from_camera(), rng, 0.003, np.deg2rad(1.0))
    base_from_board = shifted(nominal.base_from_table(), rng, 0.010, np.deg2rad(1.0))
    views = table_from_cameras(count, rng) if views is None else views
    tags = []
    for view in np.linalg.inv(views):
        tags.append(
            {
                tag: CAMERA.project(scale * corners @ view[:3, :3].T + view[:3, 3]) + rng.normal(0, noise_px, (4, 2))
                for tag, corners in BOARD.corners().items()
            }
        )
    return Sight(flange_from_camera, base_from_board, base_from_board @ views @ np.linalg.inv(flange_from_camera), tags)
