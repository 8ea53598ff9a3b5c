"""The record `registration.json` as later stages read it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsbridge.cameras import Camera, given_camera
from gsbridge.errors import InputError
from gsbridge.files import read_json
from gsbridge.geometry import Array, rotation_angle
from gsbridge.robot.assembly import check_reach, check_rigid


@dataclass(frozen=True)
class Registration:
    """Registered poses of table and camera.

    Args:
        base_from_table: Pose of the table, m. [4, 4].
        flange_from_camera: Pose of the wrist camera on the flange, OpenCV axes, m. [4, 4].
        reasons: Why the registration is degraded; empty if it passed.
        camera: Intrinsics of the wrist camera's photos, with distortion; None where the poses were typed.
    """

    base_from_table: Array
    flange_from_camera: Array
    reasons: tuple[str, ...] = ()
    camera: Camera | None = None


def read_registration(path: str | Path) -> Registration:
    """Read `registration.json`.

    Raises:
        InputError: The file is missing or damaged.
    """
    content, remedy = read_json(path), "Delete the file and register again"
    try:
        poses = [check_rigid(content[key], f"{path}: {key}") for key in ("base_from_table", "flange_from_camera")]
        table, mount = (check_reach(pose, path) for pose in poses)
        reasons, camera = content["reasons"], content.get("camera")
        if not (isinstance(reasons, list) and all(isinstance(reason, str) for reason in reasons)):
            raise TypeError("its reasons are no list of sentences")
    except (KeyError, OverflowError, TypeError, ValueError) as error:
        raise InputError(path, f"the registration is damaged ({error})", remedy) from error
    return Registration(table, mount, tuple(reasons), None if camera is None else given_camera(camera, path, remedy))


def pose_error(found: Array, truth: Array) -> tuple[float, float]:
    """Return the distance between the origins of two poses, m, and the angle between their axes, rad. [4, 4] each."""
    shift = float(np.linalg.norm(np.asarray(found)[:3, 3] - np.asarray(truth)[:3, 3]))
    return shift, float(rotation_angle(np.asarray(found)[:3, :3].T @ np.asarray(truth)[:3, :3]))
