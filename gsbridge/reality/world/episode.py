"""Photos by the mirror's wrist camera at the states of an episode that was played in another world."""

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

    Arm, fingers and object are set to the poses that the states give; the mirror's own physics is not simulated.

    Args:
        states: File of states as `gsbridge.tasks.views` defines it, in the order of the episode.
        setting: Object, background and board in the room.
        hidden_seed: Seed of the hidden parameters.
        out: Folder for the photos `{step}.png`.
        record: Record of the stage to write.
        exposure: Settings of the photos.
        every: Number of states from photo to photo.

    Raises:
        InputError: The states are damaged, or object or background is unknown.
    """
    found = read_states(states)
    chosen = found[::every] + ([found[-1]] if (len(found) - 1) % every else [])
    photos = {f"{state.step:04d}.png": state for state in chosen}
    take_photos(photos, setting, Hidden.draw(hidden_seed), out, record, exposure, seed=hidden_seed, every=every)
