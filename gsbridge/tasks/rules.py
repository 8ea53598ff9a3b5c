"""The rules of each task as settings.

They stand apart from the judges because the judges' kernels would load numba at every start of snakemake.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsbridge.errors import InputError


@dataclass(frozen=True)
class Grasp:
    """Rules of grasping.

    Args:
        lift: Height over the table that the object's lowest point must reach, m.
        hold_steps: Consecutive steps for which the object must be held at that height.
        grip_force: Smallest force of each pad with which the object counts as held, N.
        area_centre: Middle of the area in which the robot can pick the object up, table frame, m.
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


@dataclass(frozen=True)
class Place:
    """Rules of picking up and placing; `tolerance`, `seat`, `tilt` and `speed` must hold for an object to count as placed.

    Args:
        plate_centre: Middle of the plate, table frame, m.
        plate_height: Height over the table on which an object in the plate rests, m.
        tolerance: Largest horizontal distance of the object from the plate's middle, m.
        seat: Largest distance of the object's lowest point from the plate's surface, m.
        tilt: Largest tilt of the object, rad.
        speed: Largest speed of an object at rest, m/s.
        settle_steps: Consecutive steps for which the object must lie placed and released.
        grip_force: Smallest force of each pad with which the object counts as held, N.
        touch_force: Smallest force that counts as a touch, N: pad on the released object, gripper on plate or table.
        max_contact_force: Largest force with which the carried object may press on plate or table, N.
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
