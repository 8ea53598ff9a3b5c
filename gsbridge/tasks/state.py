"""What a task sees of the world: the state of many worlds at once, from whichever simulator or log."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array, rotation_from_quat

_WIDTHS = {
    "tool_position": 3,
    "tool_quat": 4,
    "pad_forces": 2,
    "object_position": 3,
    "object_quat": 4,
    "object_velocity": 3,
    "object_spin": 3,
}


@dataclass(frozen=True)
class State:
    """N worlds, one row each; table frame, SI units, quaternions wxyz.

    Args:
        tool_position: Tool point. [N, 3].
        tool_quat: `table_from_tool`. [N, 4].
        aperture: Distance of the pads, m. [N].
        pad_forces: Normal force of the left and of the right pad on the object, N. [N, 2].
        object_position: Origin of the body frame, the footprint's centre. [N, 3].
        object_quat: `table_from_object`. [N, 4].
        object_velocity: Velocity of the body's origin. [N, 3].
        object_spin: Angular velocity. [N, 3].
        object_clearance: Height of the object's lowest point over the table top. [N].
        robot_contact: Sum of normal forces between the robot and the table or the plate, N. [N].
        object_contact: Sum of normal forces between the object and the table or the plate, N. [N].
    """

    tool_position: Array
    tool_quat: Array
    aperture: Array
    pad_forces: Array
    object_position: Array
    object_quat: Array
    object_velocity: Array
    object_spin: Array
    object_clearance: Array
    robot_contact: Array
    object_contact: Array

    def __post_init__(self) -> None:
        count = len(np.atleast_1d(self.aperture))
        for name in _NAMES:
            value = np.asarray(getattr(self, name), dtype=np.float64)
            wanted = (count, _WIDTHS[name]) if name in _WIDTHS else (count,)
            if value.shape != wanted:
                raise ValueError(f"State.{name} has the shape {value.shape}, expected {wanted}")
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        """Number of worlds."""
        return len(self.aperture)

    def gripped(self, force: float) -> Array:
        """Whether both pads press on the object with at least `force`, N. bool [N]."""
        return (self.pad_forces >= force).all(1)

    def finite(self) -> Array:
        """Worlds without a NaN or an infinity. bool [N]."""
        return self._finite

    @cached_property
    def _finite(self) -> Array:
        count = len(self)
        every = np.concatenate([getattr(self, name).reshape(count, -1) for name in _NAMES], axis=1)
        return np.isfinite(every).all(1)

    def tool_yaw(self) -> Array:
        """Turn of the tool about the vertical, rad; see `gsbridge.robot.reach.tool_down`. [N]."""
        w, x, y, z = self.tool_quat.T
        return np.arctan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z)

    def tilt(self) -> Array:
        """Angle between the object's upright axis and the vertical, rad. [N]."""
        up = rotation_from_quat(self.object_quat)[:, :, 2]
        return np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2])


_NAMES = tuple(item.name for item in fields(State))


def clearance(points: Array, position: Array, quat: Array) -> Array:
    """Height of an object's lowest point over the table top, for `State.object_clearance`.

    Args:
        points: Vertices of the object's convex hull, body frame, m. [P, 3].
        position: Origin of the body frame, table frame. [N, 3].
        quat: `table_from_object`, wxyz. [N, 4].

    Returns:
        m. [N].

    Raises:
        InputError: No points.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1:] != (3,) or len(points) == 0:
        raise InputError("object", "its hull has no vertices", "Run the asset stage again")
    down = rotation_from_quat(quat)[:, 2, :]
    return np.asarray(position)[:, 2] + (down @ points.T).min(1)
