"""Postures of the arm over an object at which the wrist camera takes photos, and the pictures that splats predict there.

For each posture: joint angles, the object's place, the camera's pose, and the depth of every pixel. A robot takes photos from
these postures while all is well, and again when a policy fails (`gsbridge.gap.image`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from gsbridge.environment.build import StageFiles, build_controller, build_environment, build_renderer, camera_response
from gsbridge.environment.env import state_of
from gsbridge.environment.gaussian_renderer import GaussianRenderer
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.environment.views import SHARES, STATES, moment_of
from gsbridge.errors import StageError
from gsbridge.files import atomic_directory, write_json, write_stage
from gsbridge.images import write_image
from gsbridge.logs import ProgressLog
from gsbridge.sim.camera import respond
from gsbridge.tasks.views import DEPTHS, ROLES, VIEWS, write_states

_SOLID = 0.9
"""Share of a pixel that splats must cover for its depth to be known."""


def draw_postures(
    files: StageFiles, settings: EnvironmentSettings, out: str | Path, record: str | Path, *, count: int, seed: int
) -> None:
    """Let the baseline controller grasp from random starts, and keep one moment of each.

    Args:
        files: What the environment is made of.
        settings: Settings of the environment; its renderer is `gs`.
        out: Folder: `states.json` (`gsbridge.tasks.views`), `views.json` (camera; name, role and `cam_from_world` of each
            view), `depths.npz` (`depths`, [N, H, W] float32, camera z, m, 0 where unknown), and the drawn pictures
            `{view}.png`.
        record: Record of the stage.
        count: Number of postures.
        seed: Seed of the start poses; they are in none of the sets that policies are judged by.

    Raises:
        InputError: A file is missing or of the wrong kind.
        StageError: No grasp holds the object.
    """
    renderer = cast(GaussianRenderer, build_renderer(files, settings))
    environment, controller = build_environment(files, settings), build_controller(files.item, settings)
    # The camera as it was calibrated, but without noise, which is no part of the prediction.
    response, rng = replace(camera_response(files), shot_noise=0.0, read_noise=0.0), np.random.default_rng(0)
    progress, states, views, depths, held = ProgressLog(count, "postures"), [], [], [], 0
    with atomic_directory(out) as folder:
        for start in range(count):
            _, info = environment.reset(seed=seed + start)
            moments, gripped, over = [moment_of(environment, info, start)], False, False
            while not (gripped or over):
                _, _, terminated, truncated, info = environment.step(controller(state_of(info))[0])
                moments.append(moment_of(environment, info, start))
                gripped = bool(state_of(info).gripped(controller.firm)[0])
                over = terminated or truncated
            held += gripped
            state, poses, camera = moments[round(SHARES[start % len(SHARES)] * (len(moments) - 1))]
            shot, name = renderer.shot(poses, camera), f"{start:02d}"
            solid = np.asarray(shot.alphas) > _SOLID
            depths.append(np.where(solid, np.asarray(shot.depths), 0.0).astype(np.float32))
            write_image(folder / f"{name}.png", respond(shot.pixels, response, rng))
            views.append({"name": name, "role": ROLES[start % len(ROLES)], "cam_from_world": camera.tolist()})
            states.append(state)
            progress.update()
        environment.close()
        if held == 0:
            raise StageError("postures", "the controller holds the object in no episode", "Look at the asset's hulls and mass")
        write_states(folder / STATES, states, "random")
        write_json(folder / VIEWS, {"camera": renderer.camera.to_json(), "views": views})
        np.savez_compressed(folder / DEPTHS, depths=np.stack(depths))
    lost = count - held
    write_stage(
        record,
        reasons=[f"{lost} of {count} grasps did not hold the object"] if lost else [],
        packages=("pybullet", "numba"),
        postures=count,
        held=held,
        seed=seed,
        image_size=settings.image_size,
    )
