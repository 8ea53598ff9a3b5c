"""Camera paths: steps of keyframes, the object whole, the board seen, the table covered."""

from __future__ import annotations

import numpy as np
import pytest

from gsbridge.cameras import camera_centre
from gsbridge.photogrammetry.board import standard_board
from gsbridge.reality.mirror.backgrounds import WORK_CENTRE_M
from gsbridge.reality.mirror.lens import phone
from gsbridge.reality.mirror.path import OBJECT_SPOT_M, background_path, object_path, pan_path

CAMERA = phone(640, 480)


def _seen(points, pose):
    """Which points fall on the film. [N, 3] -> [N] bool."""
    pixels = CAMERA.project(points @ pose[:3, :3].T + pose[:3, 3])
    return ((pixels > 2) & (pixels < [638, 478])).all(-1)


def _tags_seen(pose):
    return sum(_seen(corners, pose).all() for corners in standard_board("a4").corners().values())


def _steps_deg(poses, centre):
    """Angles between neighbouring views of a centre, degrees."""
    ways = camera_centre(poses) - centre
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return np.degrees(np.arccos(np.einsum("ij,ij->i", ways[1:], ways[:-1])))


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("height", [0.037, 0.12])
def test_object_path_shows_object_and_board(seed, height):
    poses = object_path(56, height, np.random.default_rng(seed))
    angle = np.linspace(0, 2 * np.pi, 40)
    rim = np.stack([OBJECT_SPOT_M[0] + 0.06 * np.cos(angle), OBJECT_SPOT_M[1] + 0.06 * np.sin(angle), 0 * angle], axis=-1)
    box = np.concatenate([rim, rim + np.array([0, 0, height])])
    assert all(_seen(box, pose).all() for pose in poses)
    assert np.mean([_tags_seen(pose) >= 3 for pose in poses]) >= 0.9
    steps = _steps_deg(poses, np.array([0, 0.12, 0.03]))
    assert 4 < np.median(steps) < 9
    assert steps.max() < 11
    distance = np.linalg.norm(camera_centre(poses) - [0, 0.12, 0.03], axis=1)
    assert distance.min() > 0.36
    assert distance.max() < 0.45


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_background_path_covers_the_table_from_several_sides(seed):
    poses = background_path(56, np.random.default_rng(seed))
    x, y = np.meshgrid(np.linspace(-0.45, 0.45, 19), WORK_CENTRE_M[1] + np.linspace(-0.35, 0.35, 15))
    table = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=-1)
    seen = np.stack([_seen(table, pose) for pose in poses])
    assert seen.sum(0).min() >= 2
    assert np.percentile(seen.sum(0), 5) >= 6
    away = camera_centre(poses)[:, None, :2] - table[None, :, :2]
    unit = away / np.linalg.norm(away, axis=-1, keepdims=True)
    together = np.linalg.norm((unit * seen[..., None]).sum(0), axis=1) / seen.sum(0)
    assert np.percentile(together, 80) < 0.8  # 1: all views of a place come from one side
    assert np.mean([_tags_seen(pose) >= 3 for pose in poses]) >= 0.9


def test_poses_are_rigid_and_no_two_alike():
    poses = np.concatenate([object_path(56, 0.06, np.random.default_rng(3)), background_path(56, np.random.default_rng(3))])
    rotations = poses[:, :3, :3]
    assert np.allclose(rotations @ rotations.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(rotations), 1)
    centres = camera_centre(poses)
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=-1) + np.eye(len(centres))
    assert gaps.min() > 1e-3
    assert (centres[:, 2] > 0.1).all()


def test_pan_is_smooth_and_still_where_time_stands():
    pan = pan_path(np.random.default_rng(4), 0.058)
    assert np.array_equal(pan(np.array([0.3])), pan(np.array([0.1, 0.3]))[1:])
    steps = _steps_deg(pan(np.linspace(0, 1, 150)), np.array([0, 0.12, 0.03]))
    assert steps.max() < 2.0
