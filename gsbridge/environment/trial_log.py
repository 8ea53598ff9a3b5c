"""Log of trials: paths and pictures of a set of episodes in one file, for figures, films and recordings.

**File**, one `.npz` without pickles; table frame, SI. T trials; N states of all trials one after the other, the first of each
before any action:

| array | shape | meaning |
|---|---|---|
| `pose_set`, `index` | [T] str; [T] int | start pose |
| `first` | [T + 1] | trial k holds the states `first[k]` to `first[k + 1]` |
| `tool`, `tool_yaw`, `aperture` | [N, 3]; [N]; [N] | measured tool point, turn about the vertical, opening |
| `object_position`, `object_quat` | [N, 3]; [N, 4] | pose of the object, wxyz |
| `forces` | [N, 4] | `gsbridge.tasks.episode.FORCES` |
| `actions` | [N, 5] | action in this state; zeros in a trial's last |
| `picture_first`, `pictures` | [N + 1]; [B] uint8 | JPEG of the picture in state k: bytes `picture_first[k]` to `[k + 1]` |
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.reading import regular_file
from gsbridge.tasks.episode import FORCES

QUALITY = 92
"""Quality of the JPEGs: they take a fifth of the bytes of a PNG, at errors below the sensor's noise."""

_PATHS = {
    "tool": (3,),
    "tool_yaw": (),
    "aperture": (),
    "object_position": (3,),
    "object_quat": (4,),
    "forces": (len(FORCES),),
    "actions": (5,),
}


@dataclass(frozen=True)
class TrialPath:
    """One trial of N states; the module's docstring describes the arrays.

    Raises:
        ValueError: Arrays do not fit together.
    """

    pose_set: str
    index: int
    tool: Array
    tool_yaw: Array
    aperture: Array
    object_position: Array
    object_quat: Array
    forces: Array
    actions: Array
    jpegs: tuple[bytes, ...]

    def __post_init__(self) -> None:
        for name, behind in _PATHS.items():
            if np.shape(getattr(self, name)) != (len(self.jpegs), *behind):
                raise ValueError(f"{name} has the shape {np.shape(getattr(self, name))}, expected {(len(self.jpegs), *behind)}")

    def __len__(self) -> int:
        """Number of states: one more than steps."""
        return len(self.jpegs)

    def pictures(self) -> Array:
        """Pictures that the policy saw. uint8 [N, H, W, 3]."""
        return np.stack([decode(jpeg) for jpeg in self.jpegs])


def encode(picture: Array) -> bytes:
    """A picture as JPEG. uint8 [H, W, 3] RGB."""
    # Without subsampling of colours: at 64 pixels it would smear the object.
    options = [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    done, content = cv2.imencode(".jpg", np.ascontiguousarray(picture[..., ::-1]), options)
    if not done:
        raise ValueError("the picture cannot be encoded")
    return content.tobytes()


def decode(jpeg: bytes) -> Array:
    """A picture from JPEG. uint8 [H, W, 3] RGB.

    Raises:
        ValueError: The bytes are no picture.
    """
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise ValueError("a picture is damaged")
    return picture[..., ::-1]


def write_trial_log(path: str | Path, trials: Sequence[TrialPath]) -> None:
    """Write trials, whole or not at all."""
    jpegs = [jpeg for trial in trials for jpeg in trial.jpegs]
    arrays: dict[str, Any] = {name: np.concatenate([getattr(trial, name) for trial in trials]) for name in _PATHS}
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file,
            pose_set=np.array([trial.pose_set for trial in trials]),
            index=np.array([trial.index for trial in trials]),
            first=np.cumsum([0, *(len(trial) for trial in trials)]),
            picture_first=np.cumsum([0, *(len(jpeg) for jpeg in jpegs)]),
            pictures=np.frombuffer(b"".join(jpegs), np.uint8),
            **{name: value if name == "actions" else value.astype(np.float32) for name, value in arrays.items()},
        )


def read_trial_log(path: str | Path) -> list[TrialPath]:
    """Read what `write_trial_log` wrote.

    Raises:
        InputError: The file is missing or damaged.
    """
    regular_file(path, "log of the trials", "Run the rule that makes it")
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
        return [_trial(content, k) for k in range(len(content["index"]))]
    except (OSError, EOFError, KeyError, TypeError, ValueError, IndexError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(path, f"the log of the trials is damaged ({error})", "Delete it and run the rule again") from error


def _trial(content: dict[str, Array], k: int) -> TrialPath:
    begin, end = content["first"][k : k + 2]
    places, pictures = content["picture_first"], content["pictures"]
    jpegs = tuple(pictures[places[n] : places[n + 1]].tobytes() for n in range(begin, end))
    paths = {item.name: content[item.name][begin:end] for item in fields(TrialPath) if item.name in _PATHS}
    return TrialPath(pose_set=str(content["pose_set"][k]), index=int(content["index"][k]), jpegs=jpegs, **paths)
