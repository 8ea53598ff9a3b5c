"""Inputs of actor and critics, and label of the auxiliary head; the same code for training and deployment.

The **actor** sees the picture, scaled to -0.5..0.5, and `proprio` as it is (`gsbridge.environment.proprioception`). The
**critics** see no picture but the privileged vector, which no deployed policy needs:

| entry | meaning | unit |
|---|---|---|
| 0, 1, 2 | tool point from the middle of the start region, height over the table | 0.15 m |
| 3, 4 | sine and cosine of the tool's yaw | |
| 5 | opening | the stroke |
| 6, 7 | force of each pad, tanh | 20 N |
| 8, 9, 10 | object's origin minus tool point | 0.15 m |
| 11, 12 | sine and cosine of the object's yaw | |
| 13, 14 | horizontal part of the object's upright axis | |
| 15 | clearance of the object | 0.1 m |
| 16, 17, 18 | velocity of the object | 0.5 m/s |
| 19, 20 | contact force of robot and of object with table or plate, tanh | 20 N |
| 21, 22 | plate's middle minus object's origin; 0 without a plate | 0.15 m |
| 23 | consecutive steps for which the goal has been met | steps needed |
| 24 | 1 after excess contact, which forfeits the reward | |
| 25 ... 29 | commanded minus measured tool pose and opening: entries 6 to 10 of `proprio` | an action |

Entries are cut at +-10; an entry that is not finite becomes 0. The **position label** is the object's origin minus the tool
point, in units of 0.1 m, in a frame turned by the tool's yaw: this is what the wrist camera shows directly.

Source: RL-GSBridge's code, whose critics see a state of 20 entries and no picture.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gsbridge.environment.env import PROPRIO, PickEnvironment, state_of
from gsbridge.errors import InputError
from gsbridge.geometry import Array, rotation_from_quat
from gsbridge.sim.actions import SIZE
from gsbridge.tasks.rules import Grasp
from gsbridge.tasks.state import State

PRIVILEGED = 30
POSITION = 3
PICTURE_SCALE, PICTURE_OFFSET = 1.0 / 255.0, -0.5
BOUND = 10.0

_PLACE_M, _LABEL_M, _CLEARANCE_M, _SPEED, _FORCE = 0.15, 0.1, 0.1, 0.5, 20.0
_COMMAND = slice(6, 11)

Controller = Callable[[State], Array]
"""Function that returns actions [N, 5] for the states of N worlds."""


@dataclass(frozen=True)
class ObservedFrame:
    """Reference points and sizes of the privileged vector.

    Args:
        centre: Middle of the start region, table frame, m. [2].
        stroke: Largest opening of the gripper, m.
        plate: Middle of the plate, m, [2]; None without one.
        needed_steps: Consecutive steps for which the goal must be met.
    """

    centre: tuple[float, float]
    stroke: float
    plate: tuple[float, float] | None = None
    needed_steps: int = 1

    @classmethod
    def of(cls, environment: PickEnvironment) -> ObservedFrame:
        """The frame of an environment."""
        settings = environment.settings
        plate = None if settings.plate is None else (settings.plate.x, settings.plate.y)
        centre = (float(settings.start_centre[0]), float(settings.start_centre[1]))
        rules = environment.rules
        needed = rules.hold_steps if isinstance(rules, Grasp) else rules.settle_steps
        return cls(centre, environment.target.stroke, plate, needed)


@dataclass(frozen=True)
class TrainingState:
    """One state, as a training stores it.

    Args:
        image: Picture of the wrist camera, uint8 [H, W, 3].
        proprio: Proprioception, float32 [12].
        privileged: Privileged vector, float32 [30].
        position: Label of the auxiliary head, float32 [3].
        base: The controller's action, float32 [5]; zeros without one.
    """

    image: Array
    proprio: Array
    privileged: Array
    position: Array
    base: Array


class Observer:
    """Makes a `TrainingState` from an environment's observation and `info`.

    Args:
        frame: See `ObservedFrame`.
        controller: Gives the action that each state is labelled with; None for no labels.
    """

    def __init__(self, frame: ObservedFrame, controller: Controller | None = None) -> None:
        self.frame, self.controller = frame, controller

    def __call__(self, observation: Mapping[str, Array], info: Mapping[str, Any]) -> TrainingState:
        """Return the present state, as a training stores it."""
        state = state_of(info)
        memory = np.array([[float(info["terms"].get(name, 0.0)) for name in ("streak", "excess")]])
        base = np.zeros(SIZE, np.float32) if self.controller is None else np.asarray(self.controller(state)[0], np.float32)
        proprio = np.asarray(observation["proprio"], np.float32)
        return TrainingState(
            np.asarray(observation["image"]),
            proprio,
            privileged(state, proprio[None], self.frame, memory)[0],
            position_label(state)[0],
            base,
        )


def privileged(state: State, proprio: Array, frame: ObservedFrame, memory: Array | None = None) -> Array:
    """Privileged vectors of N worlds, which the critics see; see the module.

    Args:
        state: N worlds.
        proprio: Proprioception of N worlds. [N, 12].
        frame: See `ObservedFrame`.
        memory: Memory of the task: consecutive steps for which the goal has been met, and excess contact, 0 or 1, [N, 2]; None
            for zeros.

    Returns:
        float32 [N, 30].
    """
    count = len(state)
    tool, turn = rotation_from_quat(state.tool_quat), rotation_from_quat(state.object_quat)
    tool_yaw, yaw = np.arctan2(tool[:, 1, 0], tool[:, 0, 0]), np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    plate = np.zeros((count, 2)) if frame.plate is None else np.asarray(frame.plate) - state.object_position[:, :2]
    met = np.zeros((count, 2)) if memory is None else np.asarray(memory, np.float64)
    values = np.column_stack(
        [
            (state.tool_position - [*frame.centre, 0.0]) / _PLACE_M,
            np.sin(tool_yaw),
            np.cos(tool_yaw),
            state.aperture / frame.stroke,
            np.tanh(state.pad_forces / _FORCE),
            (state.object_position - state.tool_position) / _PLACE_M,
            np.sin(yaw),
            np.cos(yaw),
            turn[:, :2, 2],
            state.object_clearance / _CLEARANCE_M,
            state.object_velocity / _SPEED,
            np.tanh(state.robot_contact / _FORCE),
            np.tanh(state.object_contact / _FORCE),
            plate / _PLACE_M,
            np.minimum(met / [frame.needed_steps, 1.0], 1.0),
            np.asarray(proprio)[:, _COMMAND],
        ]
    )
    return _tame(values)


def position_label(state: State) -> Array:
    """Position of the object relative to the tool, in the frame of the tool's yaw; see the module. float32 [N, 3]."""
    tool = rotation_from_quat(state.tool_quat)
    yaw = np.arctan2(tool[:, 1, 0], tool[:, 0, 0])
    away = state.object_position - state.tool_position
    cosine, sine = np.cos(yaw), np.sin(yaw)
    turned = np.column_stack([cosine * away[:, 0] + sine * away[:, 1], cosine * away[:, 1] - sine * away[:, 0], away[:, 2]])
    return _tame(turned / _LABEL_M)


def picture(image: Tensor) -> Tensor:
    """Convert pictures to the encoder's input.

    Args:
        image: uint8 [B, H, W, 3].

    Returns:
        float32 [B, 3, H, W], -0.5..0.5; a view of interleaved colours (channels last), on which convolutions are fastest.
    """
    return image.float().mul_(PICTURE_SCALE).add_(PICTURE_OFFSET).permute(0, 3, 1, 2)


def actor_input(observation: Mapping[str, Array], image_size: int) -> tuple[Tensor, Tensor]:
    """Convert one observation of an environment or a robot to the actor's input.

    Args:
        observation: `image`, uint8 [H, W, 3], and `proprio`, [12].
        image_size: Edge that the actor was trained for, px.

    Returns:
        Picture [1, 3, H, W] and proprio [1, 12], float32.

    Raises:
        InputError: The observation has a wrong type or shape, or is not finite.
    """
    image, proprio = np.asarray(observation["image"]), np.asarray(observation["proprio"], np.float32)
    if image.dtype != np.uint8 or image.shape != (image_size, image_size, 3):
        raise InputError(
            "observation: image",
            f"it is {image.dtype} {image.shape}, the policy takes uint8 ({image_size}, {image_size}, 3)",
            "Give the picture of the wrist camera in the policy's size",
        )
    if proprio.shape != (PROPRIO,) or not np.isfinite(proprio).all():
        raise InputError(
            "observation: proprio", f"it has the shape {proprio.shape} or is not finite", f"Give {PROPRIO} finite numbers"
        )
    # A copy: the environment may draw its next picture into the same memory.
    return picture(torch.from_numpy(image.copy())[None]), torch.from_numpy(proprio.copy())[None]


def _tame(values: Array) -> Array:
    """Cut values to the bound; values that are not finite, as in a world that broke down, become zero. float32."""
    return np.clip(np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0), -BOUND, BOUND).astype(np.float32)
