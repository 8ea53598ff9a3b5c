"""Proprioception of an arm, and its next command: the same code for training, trials and robots.

`proprio` of the observation, float32, cut to +-`PROPRIO_BOUND`:

| entry | meaning | unit |
|---|---|---|
| 0, 1, 2 | measured tool point | half the workspace, 0 in its middle |
| 3, 4 | sine and cosine of the tool's yaw | |
| 5 | measured opening | the stroke |
| 6, 7, 8 | commanded minus measured tool point | an action of 1 |
| 9 | commanded minus measured yaw | an action of 1 |
| 10 | commanded minus measured opening; stays below zero on a gripped object | an action of 1 |
| 11 | change of the measured opening since the observation before; 0 in the first | 10 mm |

Fingers that are commanded to close but stand still hold something. Without the last entry a policy can tell this only from the
opening itself: it learns the reconstructed object's width to the millimetre, and waits for ever at a real object that is 1 mm
wider.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gsbridge.geometry import Array
from gsbridge.sim.actions import ToolTarget
from gsbridge.tasks.state import State

PROPRIO = 12
OPENING, OPENING_ERROR = 5, 10
"""Entries of `proprio` that say how wide the gripper is open."""

PROPRIO_BOUND = 10.0
"""Entries of `proprio` are cut here; in an episode without mishap they stay below 5."""

_TRAVEL_M = 0.01


@dataclass(frozen=True)
class Reached:
    """Pose of the tool and opening of the gripper as measured.

    Args:
        position: Tool point, table frame, m. [3].
        yaw: Turn of the tool about the vertical, rad; see `gsbridge.robot.reach.tool_down`.
        aperture: Distance of the pads, m.
        travel: Change of the aperture since the control step before, m.
    """

    position: Array
    yaw: float
    aperture: float
    travel: float = 0.0

    @classmethod
    def of_state(cls, state: State) -> Reached:
        """Pose and opening in the state of one world."""
        w, x, y, z = state.tool_quat[0].tolist()
        # The formula of `State.tool_yaw`, which would take a dozen numpy calls for one number.
        yaw = math.atan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z)
        return cls(state.tool_position[0].copy(), yaw, float(state.aperture[0]))

    @classmethod
    def of_pose(cls, table_from_tool: Array, aperture: float) -> Reached:
        """Pose and opening as an arm measures them: pose of the tool in the table frame, [4, 4], and opening, m."""
        return cls(np.array(table_from_tool[:3, 3], dtype=np.float64), _yaw(np.asarray(table_from_tool)), float(aperture))

    def after(self, before: Reached | None) -> Reached:
        """This reading with the travel of the fingers since the one before, which is None at the beginning of an episode."""
        travel = 0.0 if before is None else self.aperture - before.aperture
        return Reached(self.position, self.yaw, self.aperture, travel)


def begin(target: ToolTarget, reached: Reached) -> None:
    """Begin an episode: the command is where the tool stands."""
    target.reset(reached.position, reached.yaw, reached.aperture)


def next_command(target: ToolTarget, reached: Reached, action: Array) -> tuple[Array, float, float]:
    """Return the command after an action: the last command, held back to near the arm (`ToolTarget.tether`), and one step more.

    Args:
        target: The last command; it is changed.
        reached: Measured pose of the tool and opening.
        action: See `gsbridge.sim.actions`. [5].

    Returns:
        Position in the table frame, m, [3], yaw, rad, and aperture, m.

    Raises:
        InputError: The action has another shape or is not finite.
    """
    target.tether(reached.position, reached.yaw, reached.aperture)
    return target.move(action)


def proprioception(target: ToolTarget, reached: Reached) -> Array:
    """`proprio` of the observation; see the module. float32 [12]."""
    # Plain numbers: on so few of them numpy takes several times as long.
    scale, workspace, yaw = target.scale, target.counted.workspace, reached.yaw
    position, goal = reached.position.tolist(), target.position.tolist()
    turn = (target.yaw - yaw + math.pi) % (2 * math.pi) - math.pi
    values = [
        *(
            (2.0 * at - low - high) / (high - low)
            for at, low, high in zip(position, workspace.lower, workspace.upper, strict=True)
        ),
        *((math.sin(yaw), math.cos(yaw)) if math.isfinite(yaw) else (0.0, 0.0)),
        reached.aperture / target.stroke,
        *((wanted - at) / scale.position for wanted, at in zip(goal, position, strict=True)),
        turn / scale.yaw,
        (target.aperture - reached.aperture) / scale.aperture,
        reached.travel / _TRAVEL_M,
    ]
    # A world that broke down ends its episode; its last observation must still be valid, without a NaN.
    return np.array(
        [0.0 if math.isnan(value) else min(max(value, -PROPRIO_BOUND), PROPRIO_BOUND) for value in values],
        dtype=np.float32,
    )


def _yaw(rotation: Array) -> float:
    """Turn about the vertical of a tool that points down, rad. [>=3, >=3]."""
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))
