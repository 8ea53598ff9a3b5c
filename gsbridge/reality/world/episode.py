"""Photos of the mirror's wrist camera along an episode that another world played."""

from __future__ import annotations

from pathlib import Path

from gsbridge.reality.world.camera import Setting
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.views import SensorExposure, take_photos
from gsbridge.tasks.views import read_states


def photograph_episode(
    states: str | Path,
    setting: Setting,
    hidden_seed: int,
    out: str | Path,
    record: str | Path,
    exposure: SensorExposure,
    *,
    every: int = 1,
) -> None:
    """Photograph the true object at every k-th state of an episode, and at its last.

    Arm and fingers are set to the joint angles of the states, the object to their pose on or over the table; the mirror's own
    physics does not act.

    Args:
        states: File of `gsbridge.tasks.views`, in the order of the episode.
        setting: What stands in the room.
        hidden_seed: Seed of the hidden parameters.
        out: Folder of `{step}.png`.
        record: Record of the stage.
        exposure: How photos are taken.
        every: Steps from photo to photo.

    Raises:
        InputError: The states are damaged, or object or background are unknown.
    """
    found = read_states(states)
    chosen = found[::every] + ([found[-1]] if (len(found) - 1) % every else [])
    photos = {f"{state.step:04d}.png": state for state in chosen}
    take_photos(photos, setting, Hidden.draw(hidden_seed), out, record, exposure, seed=hidden_seed, every=every)
