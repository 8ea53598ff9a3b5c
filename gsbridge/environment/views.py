"""What the wrist camera sees during grasps, drawn by every renderer: the simulated half of a comparison with reality."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.configuration.renderers import RENDERERS
from gsbridge.environment.build import StageFiles, build_controller, build_environment, build_renderer, camera_response
from gsbridge.environment.env import PickEnvironment, state_of
from gsbridge.environment.gaussian_renderer import GaussianRenderer
from gsbridge.environment.rendering import Renderer
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.errors import StageError
from gsbridge.files import atomic_directory, write_stage
from gsbridge.geometry import Array
from gsbridge.images import write_image
from gsbridge.logs import ProgressLog
from gsbridge.sim.camera import respond
from gsbridge.tasks.views import ViewState, write_states

STATES = "states.json"
UNSHADED = "gs_unshaded"
"""Splats without the shadows of robot and object, as RL-sim's meshes are drawn."""

SHARES = (0.35, 0.6, 0.8, 1.0)
"""Moments of a grasp, as shares of the steps until the object is held: one for each start pose in turn."""


def picture_name(index: int, renderer: str) -> str:
    """File of one picture."""
    return f"{index:02d}_{renderer}.png"


def draw_views(
    files: StageFiles,
    settings: EnvironmentSettings,
    out: str | Path,
    record: str | Path,
    *,
    count: int = 32,
    pose_set: str = "fixed",
) -> None:
    """Let the baseline controller grasp from each start of a set, and draw one moment of each with all renderers.

    Args:
        files: What the environment is made of.
        settings: Settings of the environment; its renderer is replaced by each in turn.
        out: Folder: `states.json` (`gsbridge.tasks.views`) and `{index}_{renderer}.png`.
        record: Record of the stage.
        count: Start poses, from the first on.
        pose_set: `fixed` or `unseen`.

    Raises:
        InputError: A file is missing or of the wrong kind.
        StageError: No grasp holds the object.
    """
    drawn = [name for name in RENDERERS if name != "gs_soft"]
    renderers: dict[str, Renderer] = {name: build_renderer(files, replace(settings, renderer=name)) for name in drawn}
    renderers[UNSHADED] = build_renderer(replace(files, light=None), replace(settings, renderer="gs"))
    environment = build_environment(files, replace(settings, renderer="mesh"))
    controller = build_controller(files.item, settings)
    # The camera as it was calibrated, but without the model's noise, which would only blur the comparison.
    response, rng = replace(camera_response(files), shot_noise=0.0, read_noise=0.0), np.random.default_rng(0)
    progress = ProgressLog(count, "views")
    states: list[ViewState] = []
    coverage, held = [], 0
    splats = renderers["gs"]
    assert isinstance(splats, GaussianRenderer)
    with atomic_directory(out) as folder:
        for start in range(count):
            _, info = environment.reset(seed=start, options={"pose_set": pose_set, "index": start})
            moments = [moment_of(environment, info, start)]
            gripped = False
            while not gripped:
                _, _, terminated, truncated, info = environment.step(controller(state_of(info))[0])
                moments.append(moment_of(environment, info, start))
                gripped = bool(state_of(info).gripped(controller.firm)[0])
                if terminated or truncated:
                    break
            held += gripped
            state, poses, camera = moments[round(SHARES[start % len(SHARES)] * (len(moments) - 1))]
            for name, renderer in renderers.items():
                picture = respond(renderer.render(poses, camera), response, rng)
                write_image(folder / picture_name(start, name), picture)
            coverage.append(splats.coverage(poses, camera))
            states.append(state)
            progress.update()
        environment.close()
        if held == 0:
            raise StageError("views", "the controller holds the object in no episode", "Look at the asset's hulls and mass")
        write_states(folder / STATES, states, pose_set)
    lost = count - held
    write_stage(
        record,
        reasons=[f"{lost} of {count} grasps did not hold the object"] if lost else [],
        packages=("pybullet", "numba"),
        views=count,
        held=held,
        coverage={"min": float(np.min(coverage)), "mean": float(np.mean(coverage))},
        image_size=settings.image_size,
    )


def moment_of(
    environment: PickEnvironment, info: Mapping[str, Any], start: int
) -> tuple[ViewState, Mapping[str, Array], Array]:
    """Return the state, body poses and camera pose at this moment of an episode.

    Args:
        environment: World that the episode runs in.
        info: What its last step or reset returned.
        start: Number of the start pose, which is stored in the state.

    Returns:
        State; pose of each body in the table frame, by its name; `cam_from_table` [4, 4].
    """
    world = environment.world
    state = state_of(info)
    w, x, y, z = state.object_quat[0]
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    now = ViewState(
        world.joints()[0][:7].copy(), float(state.aperture[0]), np.array([*state.object_position[0, :2], yaw]), start,
        int(info["steps"]),
    )  # fmt: skip
    return now, world.body_poses(), world.camera_pose()
