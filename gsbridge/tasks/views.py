"""Chosen states of arm and object from one world, which the cameras of other worlds can show, too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import read_json, write_json
from gsbridge.geometry import Array

ROLES = ("fit", "select", "verify")
"""Roles of the records in a diagnosis: to fit candidates, to select among the fits, to verify the selected one."""

VIEWS, DEPTHS = "views.json", "depths.npz"
"""Files of the views to photograph: the first holds camera, names, roles and poses, the second the camera z of each pixel."""


@dataclass(frozen=True)
class ViewState:
    """Arm and object at one moment.

    Args:
        q: Angles of the arm's joints, rad. [7].
        aperture: Distance of the pads, m.
        object_pose: x, y, yaw of the body frame of an object that stands on the table, [3], or its `table_from_object`, [4, 4].
        start: Index of the start pose that the episode began with.
        step: Control steps since the start.
    """

    q: Array
    aperture: float
    object_pose: Array
    start: int
    step: int


def whole_pose(pose: Array) -> Array:
    """Return `table_from_object` of a pose given as x, y, yaw on the table, or already as a matrix. [3] or [4, 4] -> [4, 4]."""
    if pose.shape == (4, 4):
        return pose
    x, y, yaw = pose
    out = np.eye(4)
    out[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    out[:2, 3] = x, y
    return out


def write_states(path: str | Path, states: Sequence[ViewState], pose_set: str) -> None:
    """Write states as JSON.

    Args:
        path: File to write.
        states: The states.
        pose_set: Name of the set of start poses that their `start` refers to.
    """
    write_json(
        path,
        {
            "pose_set": pose_set,
            "states": [
                {
                    "q": state.q.tolist(),
                    "aperture": float(state.aperture),
                    "object_pose": state.object_pose.tolist(),
                    "start": state.start,
                    "step": state.step,
                }
                for state in states
            ],
        },
    )


def read_states(path: str | Path) -> list[ViewState]:
    """Read what `write_states` wrote.

    Raises:
        InputError: The file is damaged.
    """
    try:
        return [
            ViewState(
                np.array(item["q"], dtype=np.float64).reshape(7),
                float(item["aperture"]),
                _pose(item["object_pose"]),
                int(item["start"]),
                int(item["step"]),
            )
            for item in read_json(path)["states"]
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(path, f"it holds no states ({error})", "Delete it and run the rule again") from error


def _pose(values: list) -> Array:
    """Read the pose of an object and check its shape. [3] or [4, 4]."""
    pose = np.array(values, dtype=np.float64)
    if pose.shape not in ((3,), (4, 4)):
        raise ValueError(f"a pose has the shape {pose.shape}")
    return pose
