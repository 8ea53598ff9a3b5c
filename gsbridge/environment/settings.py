"""Settings of the environment, checked when they are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gsbridge.configuration.renderers import RENDERERS
from gsbridge.errors import InputError
from gsbridge.sim.actions import ActionScale
from gsbridge.tasks.poses import KeepOut, StartRegion
from gsbridge.tasks.rules import Grasp, Place

TASKS = ("grasp", "pick_and_place")
IMAGE_SIZES = (64, 128)

MAX_POSITION_STEP = 0.024
"""Largest step of the tool along an axis, m. Source: RL-GSBridge's code, three sub-steps of 8 mm."""

DEFAULT_STEPS = {"grasp": 80, "pick_and_place": 120}
"""Steps until time-out: about twice what the baseline controllers take. (RL-GSBridge's code: 115 for both.)"""

START_SIDES = {"grasp": 0.30, "pick_and_place": 0.33}
"""Edge of the square in which objects start, m. In `pick_and_place` the plate takes the middle, so the square fills the
workspace, less 5 mm on each side."""


@dataclass(frozen=True)
class Plate:
    """The plate on which the object is to be placed.

    Args:
        x, y: Middle of the plate, table frame, m.
        height: Height over the table on which an object in it rests, m.
        keep_out: Radius around its middle in which no object starts: the plate's own and the object's, m.
    """

    x: float
    y: float
    height: float = 0.004
    keep_out: float = 0.145

    def __post_init__(self) -> None:
        if not (np.isfinite([self.x, self.y]).all() and 0 <= self.height <= 0.2 and 0 < self.keep_out <= 0.5):
            raise InputError("environment: plate", f"{self} makes no sense", "Give metres, table frame")


@dataclass(frozen=True)
class EnvironmentSettings:
    """Settings of an episode: task, pictures, actions, start poses and end.

    Args:
        task: `grasp` (lift by 10 cm and hold) or `pick_and_place` (set down on the plate and let go).
        image_size: Edge of the square image, px: 64 or 128.
        renderer: `gs` (splats), `gs_soft` (splats of the soft binding), `mesh` (meshes in one colour each) or `mesh_vertex`
            (meshes with vertex colours). Both mesh renderers exist as `…_shaded`, too, with the shadows that splats get. Worlds
            with a camera of their own do not use it.
        max_steps: Steps until time-out; None for `DEFAULT_STEPS`.
        position_step: Step of the tool for an action of 1, m; at most `MAX_POSITION_STEP`.
        yaw_step: Turn for an action of 1, rad.
        aperture_step: Change of the opening for an action of 1, m.
        max_contact_force: Largest force with which a carried object may press on plate or table, N.
        hold_steps: Consecutive steps for which a grasped object must be held up.
        start_centre: Middle of the square in which objects start, table frame, m.
        start_side: Edge of the region where objects start, m; None for `START_SIDES`.
        start_yaw: Smallest and largest yaw of the object at the start, rad.
        plate: The plate, which stays free at the start; needed for `pick_and_place`.
        pose_seed: Seed of the named pose sets.

    Raises:
        InputError: A setting is unknown or out of range.
    """

    task: str = "grasp"
    image_size: int = 128
    renderer: str = "gs"
    max_steps: int | None = None
    position_step: float = MAX_POSITION_STEP
    yaw_step: float = 0.15
    aperture_step: float = 0.042
    max_contact_force: float = 5.0
    hold_steps: int = 10
    start_centre: tuple[float, float] = (0.0, 0.265)
    start_side: float | None = None
    start_yaw: tuple[float, float] = (-0.25 * np.pi, 0.25 * np.pi)
    plate: Plate | None = None
    pose_seed: int = 0

    def __post_init__(self) -> None:
        _one_of("task", self.task, TASKS)
        _one_of("image_size", self.image_size, IMAGE_SIZES)
        _one_of("renderer", self.renderer, RENDERERS)
        if self.max_steps is not None:
            _whole("max_steps", self.max_steps, 1, 10_000)
        _whole("hold_steps", self.hold_steps, 1, 1_000)
        _whole("pose_seed", self.pose_seed, 0, 2**32 - 1)
        _between("position_step", self.position_step, 1e-4, MAX_POSITION_STEP, "m")
        _between("yaw_step", self.yaw_step, 1e-3, 1.0, "rad")
        _between("aperture_step", self.aperture_step, 1e-4, 0.14, "m")
        _between("max_contact_force", self.max_contact_force, 0.1, 1000.0, "N")
        if self.plate is not None and not isinstance(self.plate, Plate):
            raise InputError("environment: plate", f"{self.plate!r} is no plate", "Give x, y, height and keep_out")
        if self.task == "pick_and_place" and self.plate is None:
            raise InputError("environment: plate", "pick_and_place needs one", "Give its x, y and height in the table frame")
        self.region()  # checks the start region, too

    @property
    def time_out(self) -> int:
        """Steps after which an episode ends by itself."""
        return DEFAULT_STEPS[self.task] if self.max_steps is None else self.max_steps

    def action_scale(self) -> ActionScale:
        """Motion that an action of 1 commands."""
        return ActionScale(self.position_step, self.yaw_step, self.aperture_step)

    def region(self) -> StartRegion:
        """Region in which objects start; the plate stays free."""
        discs = () if self.plate is None else (KeepOut(self.plate.x, self.plate.y, self.plate.keep_out),)
        side = START_SIDES[self.task] if self.start_side is None else self.start_side
        return StartRegion((self.start_centre[0], self.start_centre[1]), side, (self.start_yaw[0], self.start_yaw[1]), discs)

    def rules(self) -> Grasp | Place:
        """Rules of the task."""
        if self.task == "grasp":
            return Grasp(hold_steps=self.hold_steps, area_centre=(self.start_centre[0], self.start_centre[1]))
        assert self.plate is not None
        return Place(
            plate_centre=(self.plate.x, self.plate.y),
            plate_height=self.plate.height,
            max_contact_force=self.max_contact_force,
            area_centre=(self.start_centre[0], self.start_centre[1]),
        )


def _one_of(name: str, value: Any, allowed: tuple[Any, ...]) -> None:
    if isinstance(value, bool) or value not in allowed:
        raise InputError(f"environment: {name}", f"{value!r} is unknown", f"Use one of {', '.join(map(str, allowed))}")


def _whole(name: str, value: Any, low: int, high: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
        raise InputError(f"environment: {name}", f"{value!r} is out of range", f"Give a whole number from {low} to {high}")


def _between(name: str, value: Any, low: float, high: float, unit: str) -> None:
    number = isinstance(value, int | float | np.floating) and not isinstance(value, bool)
    if not number or not low <= value <= high:
        raise InputError(f"environment: {name}", f"{value!r} is out of range", f"Give {low:g} to {high:g} {unit}")
