"""Hand-held camera paths: orbits at rising height with smooth random sway, so that no two frames are alike."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gsbridge.cameras import look_at
from gsbridge.geometry import Array
from gsbridge.reality.mirror.backgrounds import WORK_CENTRE_M

OBJECT_SPOT_M = (0.0, 0.185)
"""Position of objects while they are filmed, table frame, m."""


def _sway(rng: np.random.Generator, count: int) -> Callable[[Array], Array]:
    """Return smooth random motion of `count` channels with unit variance, as a function of the position 0..1 on the path."""
    waves = np.array([1.7, 3.1, 5.3, 8.9, 14.3])
    strength = np.array([1.0, 0.8, 0.6, 0.45, 0.35])
    phases = rng.uniform(0, 2 * np.pi, (count, len(waves)))
    speeds = waves * rng.uniform(0.85, 1.15, (count, len(waves)))
    norm = np.sqrt((strength**2).sum() / 2)

    def motion(t: Array) -> Array:
        angle = 2 * np.pi * speeds * np.asarray(t)[..., None, None] + phases
        return (np.sin(angle) * strength).sum(-1) / norm

    return motion


def _poses(t: Array, rng: np.random.Generator, eye: Array, target: Array, sway_m: float) -> Array:
    """Return poses with sway of position and aim (`sway_m` each) and of roll (1.5 degrees). -> cam_from_table [N, 4, 4]."""
    sway = _sway(rng, 7)(t)
    eye = eye + sway_m * sway[:, :3]
    target = target + sway_m * sway[:, 3:6] * [1, 1, 0.5]
    roll = np.radians(1.5) * sway[:, 6]
    poses = []
    for place, aim, lean in zip(eye, target, roll, strict=True):
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(lean), -np.sin(lean)], [np.sin(lean), np.cos(lean)]]
        poses.append(turn @ look_at(place, aim))
    return np.stack(poses)


def _ring(azimuth: Array, elevation: Array, distance: Array) -> Array:
    """Return offsets from the aim, m, given in spherical coordinates, rad and m. [N] each -> [N, 3]."""
    return distance[:, None] * np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    )


def object_path(
    frames: int, height: float, rng: np.random.Generator, elevation_deg: tuple[float, float] = (28.0, 55.0)
) -> Array:
    """Return a path of 1.25 orbits about object and board, at a distance of 0.39 to 0.42 m.

    Args:
        frames: Number of frames.
        height: Height of the object, m.
        rng: Random numbers.
        elevation_deg: First and last elevation of the camera, degrees.

    Returns:
        cam_from_table. [frames, 4, 4].
    """
    t = np.linspace(0, 1, frames)
    azimuth = rng.uniform(0, 2 * np.pi) + 2 * np.pi * 1.25 * t
    first, last = elevation_deg
    elevation = np.radians(first + (last - first) * t)
    distance = 0.405 + 0.015 * np.sin(2 * np.pi * 2.3 * t + rng.uniform(0, 6))
    target = np.tile([OBJECT_SPOT_M[0], 0.66 * OBJECT_SPOT_M[1], 0.35 * height], (frames, 1))
    return _poses(t, rng, target + _ring(azimuth, elevation, distance), target, 0.007)


def background_path(frames: int, rng: np.random.Generator) -> Array:
    """Return a path of 1.35 turns on two rings that sees 0.9 x 0.7 m of table around the working area from several sides.

    On the low ring, the camera looks across the table. On the high ring, it aims further out towards its own side, and so sees
    the rim of the area from near, which the low ring sees only from afar.

    Args:
        frames: Number of frames.
        rng: Random numbers.

    Returns:
        cam_from_table. [frames, 4, 4].
    """
    t = np.linspace(0, 1, frames)
    rise = np.clip((t - 0.35) / 0.3, 0, 1)
    rise = rise * rise * (3 - 2 * rise)
    azimuth = rng.uniform(0, 2 * np.pi) + 2 * np.pi * 1.35 * t
    elevation = np.radians(46 + 16 * rise + 2 * np.sin(2 * np.pi * 3 * t))
    distance = 0.60 + 0.08 * rise + 0.02 * np.sin(2 * np.pi * 2.3 * t)
    middle = np.array([WORK_CENTRE_M[0], 0.75 * WORK_CENTRE_M[1], 0.0])
    lean = (0.20 * rise)[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth), 0 * t], axis=-1)
    target = middle + lean
    return _poses(t, rng, target + _ring(azimuth, elevation, distance), target, 0.010)


def pan_path(rng: np.random.Generator, height: float) -> Callable[[Array], Array]:
    """Return a third of an orbit as a function of the position 0..1 on it, [N] -> cam_from_table [N, 4, 4].

    Args:
        rng: Random numbers.
        height: Height of the object, m.
    """
    begin = rng.uniform(0, 2 * np.pi)
    seed = int(rng.integers(1 << 31))

    def poses(t: Array) -> Array:
        t = np.asarray(t, dtype=np.float64)
        azimuth = begin + 2 * np.pi / 3 * t
        elevation = np.radians(34 + 10 * t)
        target = np.tile([OBJECT_SPOT_M[0], 0.66 * OBJECT_SPOT_M[1], 0.35 * height], (len(t), 1))
        eye = target + _ring(azimuth, elevation, np.full(len(t), 0.41))
        return _poses(t, np.random.default_rng(seed), eye, target, 0.004)

    return poses
