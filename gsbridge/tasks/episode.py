"""Record of one episode, step by step, and its file format.

**File**, one `.npz` without pickles; table frame, SI. N states, the first before any action; B bodies; pictures of S px:

| array | shape | meaning |
|---|---|---|
| `task` | str | `grasp` or `pick_and_place` |
| `start`, `start_pose` | int; [3] | index of the start pose in its set; x, y, yaw, m and rad |
| `time` | [N] | s since the start, evenly spaced |
| `joints`, `aperture` | [N, 7]; [N] | measured arm joints, rad; distance of the pads, m |
| `names`, `poses` | [B] str; [N, B, 4, 4] | bodies; their `table_from_body` |
| `cam_from_table` | [N, 4, 4] | wrist camera, OpenCV axes |
| `forces` | [N, 4] | contact forces, see `FORCES`, means over the step that led here, N |
| `clearance` | [N] | height of the object's lowest point over the table, m |
| `proprio` | [N, P] | as observed, see `gsbridge.environment.env` |
| `success`, `success_tolerant`, `failure` | [N] bool, bool, str | judgement, and the reason for failure if it ended here |
| `term_{name}` | [N] | quantities that the judgement rests on |
| `actions`, `rewards` | [N - 1, 5]; [N - 1] | action in state k, and the reward for it |
| `image_{renderer}` | uint8 [N, S, S, 3] | what the wrist camera sees, by renderer |
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.tasks.views import ViewState

FORCES = ("left_pad", "right_pad", "robot_on_table", "object_on_table")
"""Pads on the object; robot and object on the table or the plate."""

OBJECT = "object"
_SHAPES: dict[str, tuple[int | None, ...]] = {
    "joints": (7,),
    "aperture": (),
    "cam_from_table": (4, 4),
    "forces": (len(FORCES),),
    "clearance": (),
    "proprio": (None,),
    "success": (),
    "success_tolerant": (),
    "failure": (),
}
"""Shape of each array after its first axis (N); None stands for any length."""


@dataclass(frozen=True)
class Episode:
    """One episode; the module's docstring describes the arrays.

    Raises:
        ValueError: Arrays do not fit together, a pose is not finite, or there is no object.
    """

    task: str
    start: int
    start_pose: Array
    time: Array
    joints: Array
    aperture: Array
    names: tuple[str, ...]
    poses: Array
    cam_from_table: Array
    forces: Array
    clearance: Array
    proprio: Array
    success: Array
    success_tolerant: Array
    failure: Array
    actions: Array
    rewards: Array
    terms: Mapping[str, Array]
    images: Mapping[str, Array]

    def __post_init__(self) -> None:
        count = len(self.time)
        for name, behind in _SHAPES.items():
            _check(name, getattr(self, name), (count, *behind))
        _check("start_pose", self.start_pose, (3,))
        _check("time", self.time, (None,))
        _check("poses", self.poses, (count, len(self.names), 4, 4))
        _check("actions", self.actions, (count - 1, 5))
        _check("rewards", self.rewards, (count - 1,))
        for name, term in self.terms.items():
            _check(f"term_{name}", term, (count,))
        for name, image in self.images.items():
            _check(f"image_{name}", image, (count, None, image.shape[1], 3))
            if image.dtype != np.uint8:
                raise ValueError(f"image_{name} has the type {image.dtype}")
        if count < 2 or OBJECT not in self.names:
            raise ValueError("it has no step, or no object")
        # If the world broke down, its last state is not finite; pictures are drawn from these arrays, so they must be.
        for name in ("time", "joints", "aperture", "poses", "cam_from_table"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} is not finite")

    def __len__(self) -> int:
        """Number of states: one more than steps."""
        return len(self.time)

    def body(self, name: str) -> Array:
        """Poses of one body, `table_from_body`. [N, 4, 4].

        Raises:
            KeyError: There is no such body.
        """
        if name not in self.names:
            raise KeyError(f"there is no body {name!r}; there are {', '.join(self.names)}")
        return self.poses[:, self.names.index(name)]

    def states(self) -> list[ViewState]:
        """Return the states of arm, gripper and object, from which another world can show the same episode."""
        return [
            ViewState(self.joints[k], float(self.aperture[k]), self.body(OBJECT)[k], self.start, k) for k in range(len(self))
        ]


def _check(name: str, value: Array, shape: tuple[int | None, ...]) -> None:
    """Refuse an array of another shape; None stands for any length."""
    found = np.shape(value)
    if len(found) != len(shape) or any(b is not None and a != b for a, b in zip(found, shape, strict=True)):
        raise ValueError(f"{name} has the shape {found}, expected {shape}")


def write_episode(path: str | Path, episode: Episode) -> None:
    """Write an episode, whole or not at all."""
    content: dict[str, Any] = {item.name: np.asarray(getattr(episode, item.name)) for item in fields(Episode)[:-2]}
    content |= {f"term_{name}": value for name, value in episode.terms.items()}
    content |= {f"image_{name}": value for name, value in episode.images.items()}
    with atomic_file(path) as temporary:
        np.savez_compressed(temporary, **content)


def read_episode(path: str | Path) -> Episode:
    """Read what `write_episode` wrote.

    Raises:
        InputError: The file is missing or damaged.
    """
    if not Path(path).is_file():
        raise InputError(path, "the episode does not exist", "Play it: run the rule that makes it")
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
        groups: dict[str, Any] = {
            group: {name.removeprefix(start): value for name, value in content.items() if name.startswith(start)}
            for group, start in (("terms", "term_"), ("images", "image_"))
        }
        plain: dict[str, Any] = {item.name: content[item.name] for item in fields(Episode)[:-2]}
        plain["task"], plain["start"] = str(plain["task"]), int(plain["start"])
        plain["names"] = tuple(str(name) for name in plain["names"])
        return Episode(**plain, **groups)
    except (OSError, EOFError, KeyError, TypeError, ValueError, IndexError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(path, f"the episode is damaged ({error})", "Delete it and run the rule again") from error
