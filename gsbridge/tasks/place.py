"""Picking up and placing: the object lies released on the plate.

Source: RL-GSBridge, "Success is considered when the cake is placed on the plate"; "In simulation, even minor excess contacts
during the placement process are considered as task failures". That rule is kept, with its figures stated, and success is also
told without it, because a real robot is not judged by it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gsbridge.errors import InputError
from gsbridge.tasks.grasp import OFF_TABLE
from gsbridge.tasks.outcome import Failure, Outcome, Progress, reasons, strayed
from gsbridge.tasks.state import State


@dataclass(frozen=True)
class Place:
    """Rules of picking up and placing.

    Args:
        plate_centre: Middle of the plate, table frame, m.
        plate_height: Height over the table on which an object in the plate rests, m.
        tolerance: Largest horizontal distance of the object from the plate's middle, m.
        seat: Largest distance of the object's lowest point from the plate's surface, m.
        tilt: Largest tilt of the object, rad.
        speed: Largest speed of an object at rest, m/s.
        settle_steps: Steps in a row for which it must lie there.
        grip_force: Force of each pad from which the object counts as held, N.
        touch_force: Force from which a touch counts at all, N: pad on released object, gripper on plate or table.
        max_contact_force: Force with which the carried object may press on plate or table, N.
        area_centre: Middle of the area in which the robot can work, table frame, m.
        area_radius: An object that lies farther out than this has been pushed away, m.
    """

    plate_centre: tuple[float, float]
    plate_height: float = 0.004
    tolerance: float = 0.04
    seat: float = 0.010
    tilt: float = 0.5
    speed: float = 0.02
    settle_steps: int = 5
    grip_force: float = 0.5
    touch_force: float = 0.1
    max_contact_force: float = 5.0
    area_centre: tuple[float, float] = (0.0, 0.265)
    area_radius: float = 0.35

    def __post_init__(self) -> None:
        positive = (self.tolerance, self.seat, self.tilt, self.speed, self.settle_steps, self.grip_force, self.touch_force)
        if not (np.isfinite(self.plate_centre).all() and min(*positive, self.max_contact_force, self.area_radius) > 0):
            raise InputError(
                "task pick_and_place", "a distance, force or number of steps is not positive", "Correct the settings"
            )


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
    """
    finite = state.finite()
    held = state.gripped(task.grip_force) & finite
    released = state.pad_forces.max(1) < task.touch_force
    carrying = progress.lifted
    progress = progress.follow(state, grip_force=task.grip_force, lift=OFF_TABLE)
    pressing = held & (state.object_contact > task.max_contact_force)
    touching = state.robot_contact > task.touch_force
    progress = replace(progress, excess=progress.excess | (carrying & (pressing | touching)))

    distance = np.hypot(*(state.object_position[:, :2] - task.plate_centre).T)
    seated = np.abs(state.object_clearance - task.plate_height) <= task.seat
    on_plate = (distance <= task.tolerance) & seated & (state.tilt() <= task.tilt) & finite
    at_rest = np.linalg.norm(state.object_velocity, axis=1) <= task.speed
    # Pushing the object onto the plate is no pick and place.
    progress = progress.count(on_plate & released & at_rest & progress.lifted)
    tolerant = progress.streak >= task.settle_steps
    success = tolerant & ~progress.excess

    _, lost = strayed(state, held, task.area_centre, task.area_radius)
    failure = reasons(
        success,
        (Failure.NOT_FINITE, ~finite),
        (Failure.EXCESS_CONTACT, progress.excess),
        (Failure.PUSHED_AWAY, lost & ~progress.lifted),
        (Failure.NOT_GRASPED, ~progress.gripped),
        (Failure.NOT_LIFTED, ~progress.lifted),
        (Failure.NOT_RELEASED, on_plate & ~released),
        (Failure.TIME_OUT, held | on_plate),
        (Failure.DROPPED, lost),
        (Failure.MISSED_PLATE, ~held),
    )
    terms = {
        "held": held,
        "on_plate": on_plate,
        "released": released,
        "distance": distance,
        "clearance": state.object_clearance,
        "excess": progress.excess,
        "robot_contact": state.robot_contact,
        "object_contact": state.object_contact,
        "streak": progress.streak,
    }
    return progress, Outcome(success.astype(np.float64), success, tolerant, failure, terms)
