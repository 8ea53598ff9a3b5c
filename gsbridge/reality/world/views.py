"""Photos of the mirror's wrist camera at states that another world chose: the measured half of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gsbridge.asset.bundle import read_asset
from gsbridge.files import atomic_directory, write_stage
from gsbridge.images import write_image
from gsbridge.logs import ProgressLog
from gsbridge.reality.world.bodies import true_from_body
from gsbridge.reality.world.camera import Quality, Setting
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table, true_robot
from gsbridge.reality.world.mirror import build_mirror
from gsbridge.tasks.views import ViewState, read_states, whole_pose


@dataclass(frozen=True)
class SensorExposure:
    """Settings of the mirror's photos.

    Args:
        pieces: Folder that keeps convex pieces from run to run.
        size: Edge of the pictures, px.
        samples: Samples per pixel, at least.
        threads: Threads to render with.
        first: Number of the first photo; each has the noise of its number.
        item: `asset.json` of the object whose poses the states tell; None where they are those of the true object.
    """

    pieces: str | Path
    size: int
    samples: int
    threads: int = 1
    first: int = 0
    item: str | Path | None = None


def photograph_states(
    states: str | Path, setting: Setting, hidden_seed: int, out: str | Path, record: str | Path, exposure: SensorExposure
) -> None:
    """Photograph the true object at given states; arm joints are set, the camera is where it truly sits.

    Args:
        states: File of `gsbridge.tasks.views`.
        setting: What stands in the room.
        hidden_seed: Seed of the hidden parameters.
        out: Folder of `{index}.png`.
        record: Record of the stage.
        exposure: How photos are taken.

    Raises:
        InputError: The states are damaged, or object or background are unknown.
    """
    chosen = {f"{index:02d}.png": state for index, state in enumerate(read_states(states))}
    take_photos(chosen, setting, Hidden.draw(hidden_seed), out, record, exposure, seed=hidden_seed)


def photograph_postures(
    states: str | Path,
    setting: Setting,
    hidden: Hidden,
    out: str | Path,
    record: str | Path,
    exposure: SensorExposure,
    *,
    shots: int = 1,
    seed: int,
) -> None:
    """Photograph an arm that comes back to each posture some times: `{view}_{shot}.png`.

    Args:
        states: File of `gsbridge.tasks.views`.
        setting, out, record, exposure: See `photograph_states`.
        hidden: Parameters of the world.
        shots: Photos of each posture.
        seed: The world's, for the record.

    Raises:
        InputError: The states are damaged, or object or background are unknown.
    """
    chosen = {f"{index:02d}_{shot}.png": state for index, state in enumerate(read_states(states)) for shot in range(shots)}
    take_photos(chosen, setting, hidden, out, record, exposure, seed=seed, shots=shots)


def take_photos(
    chosen: Mapping[str, ViewState],
    setting: Setting,
    hidden: Hidden,
    out: str | Path,
    record: str | Path,
    exposure: SensorExposure,
    **numbers: Any,
) -> None:
    """Photograph states, each under its file name; each photo has noise of its own.

    Args:
        chosen: States by file name.
        setting, out, record, exposure: See `photograph_states`.
        hidden: Parameters of the world.
        **numbers: Further figures of the record.

    Raises:
        InputError: Object or background are unknown, a pose makes no sense, or the asset cannot be read.
    """
    progress, body_from_true = ProgressLog(len(chosen), "photos"), np.eye(4)
    if exposure.item is not None and setting.object is not None:
        seen = read_asset(exposure.item).body_from_table
        body_from_true = np.linalg.inv(true_from_body(setting.object, setting.seed, seen))
    with TemporaryDirectory() as folder, atomic_directory(out) as temporary:
        world = build_mirror(
            setting, true_robot(Path(folder) / "robot", hidden), true_base_from_table(hidden), hidden, pieces=exposure.pieces,
            threads=exposure.threads, quality=Quality(samples=exposure.samples),
        )  # fmt: skip
        for number, (name, state) in enumerate(chosen.items(), exposure.first):
            world.place(state.q, state.aperture, whole_pose(state.object_pose) @ body_from_true, number)
            write_image(temporary / name, world.image(exposure.size))
            progress.update()
    write_stage(
        record,
        packages=("mitsuba", "mujoco"),
        views=len(chosen),
        size=exposure.size,
        samples=exposure.samples,
        **numbers,
    )
