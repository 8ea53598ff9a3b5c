"""Grasping: lift the object 10 cm off the table and hold it.

Source: RL-GSBridge, "Success is considered when the object is lifted 10 cm above the table"; reward 1 on success, otherwise 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.errors import InputError
from gsbridge.tasks.outcome import Failure, Outcome, Progress, reasons, strayed
from gsbridge.tasks.state import State


@dataclass(frozen=True)
class Grasp:
    """Rules of grasping.

    Args:
        lift: Height of the object's lowest point over the table that counts, m.
        hold_steps: Steps in a row for which it must be held there.
        grip_force: Force of each pad from which the object counts as held, N.
        area_centre: Middle of the area in which the robot can pick it up, table frame, m.
        area_radius: An object that lies on the table farther out than this has been pushed away, m.
    """

    lift: float = 0.10
    hold_steps: int = 10
    grip_force: float = 0.5
    area_centre: tuple[float, float] = (0.0, 0.265)
    area_radius: float = 0.30

    def __post_init__(self) -> None:
        if not (self.lift > 0 and self.hold_steps >= 1 and self.grip_force > 0 and self.area_radius > 0):
            raise InputError("task grasp", "a height, force, radius or number of steps is not positive", "Correct the settings")


OFF_TABLE = 0.005
"""Clearance from which a held object counts as lifted at all, m: more than contact and rocking make."""


def judge(state: State, progress: Progress, task: Grasp) -> tuple[Progress, Outcome]:
    """Judge one step of N worlds.

    Args:
        state: The state after the step.
        progress: Memory up to the step before.
        task: The rules.

    Returns:
        Memory including this step, and the judgement. A world that is no longer finite never succeeds.
    """
    finite = state.finite()
    held = state.gripped(task.grip_force) & finite
    high = (state.object_clearance >= task.lift) & finite
    progress = progress.follow(state, grip_force=task.grip_force, lift=OFF_TABLE).count(held & high)
    success = progress.streak >= task.hold_steps
    away, lost = strayed(state, held, task.area_centre, task.area_radius)
    failure = reasons(
        success,
        (Failure.NOT_FINITE, ~finite),
        (Failure.PUSHED_AWAY, lost & ~progress.lifted),
        (Failure.NOT_GRASPED, ~progress.gripped),
        (Failure.NOT_LIFTED, ~progress.lifted),
        (Failure.DROPPED, ~held),
    )
    terms = {"held": held, "lifted": high, "clearance": state.object_clearance, "streak": progress.streak, "away": away}
    return progress, Outcome(success.astype(np.float64), success, success, failure, terms)
