"""Photos by the mirror's wrist camera at states from another world: the measured side of a comparison with rendered views."""

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
        pieces: Folder in which convex pieces are cached between runs.
        size: Edge of the pictures, px.
        samples: Least number of samples per pixel.
        threads: Threads to render with.
        first: Number of the first photo; a photo's number is the seed of its noise.
        item: `asset.json` of the reconstructed object whose poses the states give; None if they give those of the true object.
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
    """Photograph the true object at given states, with the arm joints set directly and the camera at its true pose.

    Args:
        states: File of states as `gsbridge.tasks.views` defines it.
        setting: Object, background and board in the room.
        hidden_seed: Seed of the hidden parameters.
        out: Folder for the photos `{index}.png`.
        record: Record of the stage to write.
        exposure: Settings of the photos.

    Raises:
        InputError: The states are damaged, or object or background is unknown.
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
    """Photograph each posture several times, as `{view}_{shot}.png`.

    Args:
        states: File of states as `gsbridge.tasks.views` defines it.
        setting, out, record, exposure: See `photograph_states`.
        hidden: Hidden parameters of the world.
        shots: Number of photos of each posture.
        seed: Seed of the world, for the record.

    Raises:
        InputError: The states are damaged, or object or background is unknown.
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
    """Photograph states and write each photo under its file name; each photo has its own noise.

    Args:
        chosen: States by file name.
        setting, out, record, exposure: See `photograph_states`.
        hidden: Hidden parameters of the world.
        **numbers: Further values for the record.

    Raises:
        InputError: Object or background is unknown, a pose is not possible, or the asset cannot be read.
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
