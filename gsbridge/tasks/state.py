"""What a task sees of the world: the state of many worlds at once, from whichever simulator or log."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from gsbridge.errors import InputError
from gsbridge.geometry import Array, rotation_from_quat
from gsbridge.kernels import njit

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
        for name in NAMES:
            value = np.asarray(getattr(self, name), dtype=np.float64)
            wanted = (count, _WIDTHS[name]) if name in _WIDTHS else (count,)
            if value.shape != wanted:
                raise ValueError(f"State.{name} has the shape {value.shape}, expected {wanted}")
            # Always the same memory order, since numba compiles a kernel anew for each order.
            object.__setattr__(self, name, np.ascontiguousarray(value))

    @classmethod
    def of_row(cls, row: Array) -> State:
        """Build the state of one world from a row of all its numbers, in the order of the fields. [`ROW`]."""
        return cls(**{name: row[columns] if name not in _WIDTHS else row[None, columns] for name, columns in COLUMNS.items()})

    def __len__(self) -> int:
        """Number of worlds."""
        return len(self.aperture)

    def gripped(self, force: float) -> Array:
        """Whether both pads press on the object with at least `force`, N. bool [N]."""
        return np.asarray(np.all(self.pad_forces >= force, axis=1))

    def finite(self) -> Array:
        """Whether all numbers of each world are finite; computed only once. bool [N]."""
        return self._finite

    @cached_property
    def _finite(self) -> Array:
        return _all_finite(*(getattr(self, name) for name in NAMES))

    def tool_yaw(self) -> Array:
        """Turn of the tool about the vertical, rad; see `gsbridge.robot.reach.tool_down`. [N]."""
        w, x, y, z = self.tool_quat.T
        return np.arctan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z)

    def tilt(self) -> Array:
        """Angle between the object's upright axis and the vertical, rad. [N]."""
        up = rotation_from_quat(self.object_quat)[:, :, 2]
        return np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2])


NAMES = tuple(item.name for item in fields(State))
_ENDS = np.cumsum([_WIDTHS.get(name, 1) for name in NAMES]).tolist()
COLUMNS = {name: slice(end - _WIDTHS.get(name, 1), end) for name, end in zip(NAMES, _ENDS, strict=True)}
"""Columns of each field in the row that holds all numbers of one world."""

ROW: int = _ENDS[-1]
"""How many numbers describe one world."""


@njit(nogil=True)
def _spoilt(value: Array, k: int) -> float:
    """Return 0 if all numbers in row `k` of `value` [N, D] are finite, NaN otherwise."""
    out = 0.0
    for i in range(value.shape[1]):
        out += value[k, i] * 0.0
    return out


@njit(nogil=True)
def _all_finite(
    tool_position: Array,
    tool_quat: Array,
    aperture: Array,
    pad_forces: Array,
    position: Array,
    quat: Array,
    velocity: Array,
    spin: Array,
    clearance: Array,
    robot_contact: Array,
    object_contact: Array,
) -> Array:
    """Worlds in which every number is finite. [N, D] or [N] each -> bool [N]."""
    out = np.empty(len(aperture), np.bool_)
    for k in range(len(aperture)):
        total = 0.0 * (aperture[k] + clearance[k] + robot_contact[k] + object_contact[k])
        total += _spoilt(tool_position, k) + _spoilt(tool_quat, k) + _spoilt(pad_forces, k)
        total += _spoilt(position, k) + _spoilt(quat, k) + _spoilt(velocity, k) + _spoilt(spin, k)
        out[k] = total == 0.0
    return out


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
