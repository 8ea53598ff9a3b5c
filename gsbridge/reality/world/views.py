"""Photos of the mirror's wrist camera at states that another world chose: the measured half of a comparison."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from gsbridge.files import atomic_directory, write_stage
from gsbridge.images import write_image
from gsbridge.logs import Progress
from gsbridge.reality.world.camera import Quality, Setting
from gsbridge.reality.world.hidden import Hidden
from gsbridge.reality.world.layout import true_base_from_table, true_robot
from gsbridge.reality.world.mirror import build_mirror
from gsbridge.tasks.views import read_states


def photograph_states(
    states: str | Path,
    setting: Setting,
    hidden_seed: int,
    out: str | Path,
    record: str | Path,
    *,
    pieces: str | Path,
    size: int,
    samples: int,
    threads: int = 1,
) -> None:
    """Photograph the true object at given states; arm joints are set, the camera is where it truly sits.

    Args:
        states: File of `gsbridge.tasks.views`.
        setting: What stands in the room.
        hidden_seed: Seed of the hidden parameters.
        out: Folder of `{index}.png`.
        record: Record of the stage.
        pieces: Folder that keeps convex pieces from run to run.
        size: Edge of the pictures, px.
        samples: Samples per pixel, at least.
        threads: Threads to render with.

    Raises:
        InputError: The states are damaged, or object or background are unknown.
    """
    hidden = Hidden.draw(hidden_seed)
    chosen = read_states(states)
    progress = Progress(len(chosen), "photos")
    with TemporaryDirectory() as folder, atomic_directory(out) as temporary:
        world = build_mirror(
            setting, true_robot(Path(folder) / "robot", hidden), true_base_from_table(hidden), hidden, pieces=pieces,
            threads=threads, quality=Quality(samples=samples),
        )  # fmt: skip
        for index, state in enumerate(chosen):
            world.physics.place(state.q, state.aperture, state.object_pose)
            write_image(temporary / f"{index:02d}.png", world.image(size))
            progress.update()
    write_stage(record, seed=hidden_seed, packages=("mitsuba", "mujoco"), views=len(chosen), size=size, samples=samples)
