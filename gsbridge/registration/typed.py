"""Poses typed by hand: a position with a quaternion, with roll, pitch and yaw, or with no rotation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array, rotation_from_quat
from gsbridge.robot.links import rotation_from_rpy

_REMEDY = "Give `position: [x, y, z]` in metres and `quaternion: [w, x, y, z]`, or `rpy_deg: [roll, pitch, yaw]`"
_FARTHEST_M = 5.0


def typed_pose(content: Mapping[str, Any], source: str) -> Array:
    """Read a pose as it was typed in the configuration. [4, 4].

    Args:
        content: `position` in metres, and `quaternion` (wxyz) or `rpy_deg` (fixed axes as in URDF); without either of them, the
            pose has no rotation.
        source: Where the pose was typed, for the error message.

    Raises:
        InputError: A key is missing or unknown, a value is not a finite number, or a position looks like millimetres.
    """
    unknown = set(content) - {"position", "quaternion", "rpy_deg"}
    if unknown or "position" not in content or {"quaternion", "rpy_deg"} <= set(content):
        raise InputError(source, f"the pose has the keys {', '.join(content) or 'none'}", _REMEDY)
    out = np.eye(4)
    out[:3, 3] = _numbers(content["position"], 3, f"{source}.position")
    if np.abs(out[:3, 3]).max() > _FARTHEST_M:
        raise InputError(f"{source}.position", "it is farther than 5 m; are these millimetres?", "Give metres")
    if "quaternion" in content:
        quat = _numbers(content["quaternion"], 4, f"{source}.quaternion")
        if abs(np.linalg.norm(quat) - 1.0) > 1e-2:
            raise InputError(f"{source}.quaternion", f"its length is {np.linalg.norm(quat):.3f}, not 1", _REMEDY)
        out[:3, :3] = rotation_from_quat(quat)
    elif "rpy_deg" in content:
        out[:3, :3] = rotation_from_rpy(np.deg2rad(_numbers(content["rpy_deg"], 3, f"{source}.rpy_deg")))
    return out


def _numbers(values: Any, count: int, source: str) -> Array:
    """Return `values` as `count` finite numbers, or raise an `InputError`."""
    try:
        out = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(source, f"{values!r} are no numbers", _REMEDY) from error
    if out.shape != (count,) or not np.isfinite(out).all():
        raise InputError(source, f"{values!r} are not {count} finite numbers", _REMEDY)
    return out
