"""A baseline controller that is wrong on purpose: policies taught by it show what reinforcement adds to imitation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.geometry import Array, quat_multiply
from gsbridge.tasks.state import State


@dataclass(frozen=True)
class BiasedController:
    """Controller that acts as if the object stood elsewhere.

    Args:
        controller: From states of N worlds to actions [N, 5].
        offset: Assumed minus true pose of the object: along x, y and z of the table, m, and turn about the vertical, rad.
            [4].
    """

    controller: Callable[[State], Array]
    offset: tuple[float, float, float, float]

    def __call__(self, state: State) -> Array:
        """Return the actions for N worlds. [N, 5]."""
        *shift, turn = self.offset
        # Controllers take the object's height from its clearance.
        believed = replace(
            state,
            object_position=state.object_position + np.array(shift),
            object_clearance=state.object_clearance + shift[2],
        )
        if turn:
            about = np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
            believed = replace(believed, object_quat=quat_multiply(about, state.object_quat))
        return self.controller(believed)


def teacher_name(offset: Sequence[float]) -> str:
    """Return the name of a controller with an offset on report pages: `exact`, `y 30 mm`, `yaw 0.20 rad`.

    Args:
        offset: The offset of `BiasedController`: x, y, z, m, and yaw, rad. [4].
    """
    *shift, turn = offset
    parts = [f"{axis} {1e3 * value:.0f} mm" for axis, value in zip("xyz", shift, strict=True) if value]
    return ", ".join(parts + [f"yaw {turn:.2f} rad"] * bool(turn)) or "exact"
