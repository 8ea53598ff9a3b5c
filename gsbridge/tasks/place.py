"""Picking up and placing: the object lies released on the plate.

Source: RL-GSBridge, "Success is considered when the cake is placed on the plate"; "In simulation, even minor excess contacts
during the placement process are considered as task failures". That rule is kept, with explicit thresholds. Success is also
reported without it, because a real robot is not judged by it.
"""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array
from gsbridge.kernels import njit
from gsbridge.tasks.grasp import OFF_TABLE
from gsbridge.tasks.outcome import REASONS, Failure, Outcome, Progress, texts
from gsbridge.tasks.rules import Place
from gsbridge.tasks.state import State

_NONE, _NOT_FINITE, _PUSHED_AWAY = map(REASONS.index, (Failure.NONE, Failure.NOT_FINITE, Failure.PUSHED_AWAY))
_NOT_GRASPED, _NOT_LIFTED = map(REASONS.index, (Failure.NOT_GRASPED, Failure.NOT_LIFTED))
_DROPPED, _TIME_OUT = map(REASONS.index, (Failure.DROPPED, Failure.TIME_OUT))
_EXCESS, _NOT_RELEASED, _MISSED = map(REASONS.index, (Failure.EXCESS_CONTACT, Failure.NOT_RELEASED, Failure.MISSED_PLATE))


def judge(state: State, progress: Progress, task: Place) -> tuple[Progress, Outcome]:
    """Judge one step of N worlds.

    Excess contact counts from the moment the object is off the table: the gripper touches plate or table, or the object,
    while held, is pressed on them harder than `max_contact_force`. Its own weight on the plate is no excess.

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
    forces = np.stack([*state.pad_forces.T, state.robot_contact, state.object_contact], axis=1)
    streak, gripped, lifted, excess, held, on_plate, released, distance, success, tolerant, codes = _judge(
        state.finite(), forces, state.object_position, state.object_velocity, state.object_clearance, state.tilt(),
        (progress.streak, progress.gripped, progress.lifted, progress.excess),
        (task.grip_force, task.touch_force, task.max_contact_force), task.plate_centre, (task.plate_height, task.seat),
        (task.tolerance, task.tilt, task.speed), task.settle_steps, task.area_centre, task.area_radius,
    )  # fmt: skip
    terms = {
        "held": held,
        "on_plate": on_plate,
        "released": released,
        "distance": distance,
        "clearance": state.object_clearance,
        "excess": excess,
        "robot_contact": state.robot_contact,
        "object_contact": state.object_contact,
        "streak": streak,
    }
    return Progress(streak, gripped, lifted, excess), Outcome(
        success.astype(np.float64), success, tolerant, texts(codes), terms
    )


@njit(nogil=True)
def _judge(
    finite: Array, forces: Array, positions: Array, velocities: Array, clearances: Array, tilts: Array,
    memory: tuple[Array, Array, Array, Array], levels: tuple[float, float, float], plate: tuple[float, float],
    rest: tuple[float, float], bounds: tuple[float, float, float], settle_steps: int,
    centre: tuple[float, float], radius: float,
) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array, Array, Array]:  # fmt: skip
    """Return the new memory (four arrays), terms (held, on plate, released, distance), both successes, indices in `REASONS`.

    Args:
        finite, positions, velocities, clearances, tilts: State of the object in N worlds.
        forces: Forces of the two pads, of the robot, and of the object on plate and table, N. [N, 4].
        memory: As in `Progress`.
        levels: Forces that count as a grip, as a touch and as excess contact, N.
        plate, rest: Middle of the plate; height of the resting object, and its largest deviation from that height; m.
        bounds: Largest distance, m, tilt, rad, and speed, m/s, of an object that lies on the plate.
        settle_steps, centre, radius: As in `Place`.
    """
    streak, gripped, lifted, excess = memory[0].copy(), memory[1].copy(), memory[2].copy(), memory[3].copy()
    count = len(streak)
    held, on_plate, released = np.empty(count, np.bool_), np.empty(count, np.bool_), np.empty(count, np.bool_)
    success, tolerant = np.empty(count, np.bool_), np.empty(count, np.bool_)
    distance, codes = np.empty(count), np.empty(count, np.int64)
    for k in range(count):
        left, right, robot, load = forces[k, 0], forces[k, 1], forces[k, 2], forces[k, 3]
        pressed, carrying = left >= levels[0] and right >= levels[0], lifted[k]
        gripped[k] |= pressed
        # The plate's rim is higher than OFF_TABLE: an object that is dragged over it does not count as lifted.
        lifted[k] |= pressed and clearances[k] >= OFF_TABLE and load < levels[1]
        held[k] = pressed and finite[k]
        released[k] = left < levels[1] and right < levels[1]
        excess[k] |= carrying and ((held[k] and load > levels[2]) or robot > levels[1])

        x, y = positions[k, 0], positions[k, 1]
        distance[k] = np.hypot(x - plate[0], y - plate[1])
        seated = abs(clearances[k] - rest[0]) <= rest[1]
        on_plate[k] = distance[k] <= bounds[0] and seated and tilts[k] <= bounds[1] and finite[k]
        square = velocities[k, 0] ** 2 + velocities[k, 1] ** 2 + velocities[k, 2] ** 2
        # Pushing the object onto the plate does not count: it must have been lifted.
        goal = on_plate[k] and released[k] and np.sqrt(square) <= bounds[2] and lifted[k]
        streak[k] = streak[k] + 1 if goal else 0
        tolerant[k] = streak[k] >= settle_steps
        success[k] = tolerant[k] and not excess[k]

        lost = np.hypot(x - centre[0], y - centre[1]) > radius and not held[k]
        if success[k]:
            codes[k] = _NONE
        elif not finite[k]:
            codes[k] = _NOT_FINITE
        elif excess[k]:
            codes[k] = _EXCESS
        elif lost and not lifted[k]:
            codes[k] = _PUSHED_AWAY
        elif not gripped[k]:
            codes[k] = _NOT_GRASPED
        elif not lifted[k]:
            codes[k] = _NOT_LIFTED
        elif on_plate[k] and not released[k]:
            codes[k] = _NOT_RELEASED
        elif held[k] or on_plate[k]:
            codes[k] = _TIME_OUT
        else:
            codes[k] = _DROPPED if lost else _MISSED
    return streak, gripped, lifted, excess, held, on_plate, released, distance, success, tolerant, codes
