"""Grasping: lift the object 10 cm off the table and hold it.

Source: RL-GSBridge, "Success is considered when the object is lifted 10 cm above the table"; reward 1 on success, otherwise 0.
"""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array
from gsbridge.kernels import njit
from gsbridge.tasks.outcome import REASONS, Failure, Outcome, Progress, texts
from gsbridge.tasks.rules import Grasp
from gsbridge.tasks.state import State

_NONE, _NOT_FINITE, _PUSHED_AWAY = map(REASONS.index, (Failure.NONE, Failure.NOT_FINITE, Failure.PUSHED_AWAY))
_NOT_GRASPED, _NOT_LIFTED = map(REASONS.index, (Failure.NOT_GRASPED, Failure.NOT_LIFTED))
_DROPPED, _TIME_OUT = map(REASONS.index, (Failure.DROPPED, Failure.TIME_OUT))


OFF_TABLE = 0.005
"""Smallest clearance, m, at which a held object counts as lifted at all: more than contact and rocking cause."""


def judge(state: State, progress: Progress, task: Grasp) -> tuple[Progress, Outcome]:
    """Judge one step of N worlds.

    Args:
        state: The state after the step.
        progress: Memory up to the step before.
        task: The rules.

    Returns:
        Memory including this step, and the judgement. A world that is no longer finite never succeeds.

    Raises:
        ValueError: The memory is that of another number of worlds.
    """
    progress.require(len(state))
    streak, gripped, lifted, held, high, away, success, codes = _judge(
        state.finite(), state.pad_forces, state.object_position, state.object_clearance,
        progress.streak, progress.gripped, progress.lifted,
        task.lift, task.hold_steps, task.grip_force, task.area_centre, task.area_radius,
    )  # fmt: skip
    terms = {"held": held, "lifted": high, "clearance": state.object_clearance, "streak": streak, "away": away}
    progress = Progress(streak, gripped, lifted, progress.excess)
    return progress, Outcome(success.astype(np.float64), success, success, texts(codes), terms)


@njit(nogil=True)
def _judge(
    finite: Array, pad_forces: Array, positions: Array, clearances: Array, streak: Array, gripped: Array, lifted: Array,
    lift: float, hold_steps: int, grip_force: float, centre: tuple[float, float], radius: float,
) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array]:  # fmt: skip
    """Return the new memory (streak, gripped, lifted), terms (held, high, away), successes, indices in `REASONS`. [N] each.

    This is a kernel because numpy is slow on single numbers: between physics and rendering, its calls take several times as
    long as by themselves.
    """
    streak, gripped, lifted = streak.copy(), gripped.copy(), lifted.copy()
    count = len(streak)
    held, high, success = np.empty(count, np.bool_), np.empty(count, np.bool_), np.empty(count, np.bool_)
    away, codes = np.empty(count), np.empty(count, np.int64)
    for k in range(count):
        pressed, clearance = pad_forces[k, 0] >= grip_force and pad_forces[k, 1] >= grip_force, clearances[k]
        gripped[k] |= pressed
        lifted[k] |= pressed and clearance >= OFF_TABLE
        held[k], high[k] = pressed and finite[k], clearance >= lift and finite[k]
        streak[k] = streak[k] + 1 if held[k] and high[k] else 0
        success[k] = streak[k] >= hold_steps
        away[k] = np.hypot(positions[k, 0] - centre[0], positions[k, 1] - centre[1])
        if success[k]:
            codes[k] = _NONE
        elif not finite[k]:
            codes[k] = _NOT_FINITE
        elif away[k] > radius and not held[k] and not lifted[k]:
            # The object left the working area without ever having been lifted.
            codes[k] = _PUSHED_AWAY
        elif not gripped[k]:
            codes[k] = _NOT_GRASPED
        elif not lifted[k]:
            codes[k] = _NOT_LIFTED
        else:
            codes[k] = _TIME_OUT if held[k] else _DROPPED
    return streak, gripped, lifted, held, high, away, success, codes
