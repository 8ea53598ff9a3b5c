"""The pose of a camera at any time, from a smooth path through poses with time stamps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from gsbridge.cameras import camera_centre
from gsbridge.geometry import Array


@dataclass(frozen=True, eq=False)
class Track:
    """Poses of a moving camera.

    Args:
        times: Rising, s. [M].
        poses: `cam_from_world`. [M, 4, 4].

    Raises:
        ValueError: Fewer than two poses, or times that do not rise.
    """

    times: Array
    poses: Array
    _centre: Any = field(init=False, repr=False, compare=False)
    _turn: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        times, poses = np.asarray(self.times, np.float64), np.asarray(self.poses, np.float64)
        if len(times) < 2 or poses.shape != (len(times), 4, 4) or not (np.diff(times) > 0).all():
            raise ValueError("a track needs two or more poses at times that rise")
        turns = Rotation.from_matrix(poses[:, :3, :3].transpose(0, 2, 1))
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "_centre", CubicSpline(times, camera_centre(poses), bc_type="natural"))
        object.__setattr__(self, "_turn", RotationSpline(times, turns))

    def at(self, times: Array) -> Array:
        """Poses at some times; before the first and after the last time stamp the camera stands still. [N] -> [N, 4, 4]."""
        when = np.clip(np.asarray(times, np.float64), self.times[0], self.times[-1])
        out = np.tile(np.eye(4), (len(when), 1, 1))
        out[:, :3, :3] = self._turn(when).as_matrix().transpose(0, 2, 1)
        out[:, :3, 3] = -np.einsum("nij,nj->ni", out[:, :3, :3], self._centre(when))
        return out
