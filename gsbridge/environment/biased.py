"""A baseline controller that is wrong on purpose: what a policy learns from it shows what reinforcement adds to imitation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsbridge.geometry import Array, quat_multiply
from gsbridge.tasks.state import State


@dataclass(frozen=True)
class BiasedController:
    """Takes the object for one that stands elsewhere.

    Args:
        controller: From states of N worlds to actions [N, 5].
        offset: Where it believes the object to be, from where it is: along x, y and z of the table, m, and turned about the
            vertical, rad. [4].
    """

    controller: Callable[[State], Array]
    offset: tuple[float, float, float, float]

    def __call__(self, state: State) -> Array:
        """Actions [N, 5]."""
        *shift, turn = self.offset
        believed = replace(state, object_position=state.object_position + np.array(shift))
        if turn:
            about = np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
            believed = replace(believed, object_quat=quat_multiply(about, state.object_quat))
        return self.controller(believed)


def teacher_name(offset: Sequence[float]) -> str:
    """What pages call a controller with an offset: `exact`, `y 30 mm`, `yaw 0.20 rad`.

    Args:
        offset: The offset of `BiasedController`: x, y, z, m, and yaw, rad. [4].
    """
    *shift, turn = offset
    parts = [f"{axis} {1e3 * value:.0f} mm" for axis, value in zip("xyz", shift, strict=True) if value]
    return ", ".join(parts + [f"yaw {turn:.2f} rad"] * bool(turn)) or "exact"
