"""One episode of the baseline controller in the simulated world, recorded step by step: see `gsbridge.tasks.episode`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gsbridge.environment.build import (
    StageFiles,
    build_controller,
    build_environment,
    build_renderer,
    camera_response,
    lens_of,
)
from gsbridge.environment.env import DrawnEye, Eye, PickEnvironment, state_of
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.files import write_stage
from gsbridge.geometry import Array
from gsbridge.sim.model import read_model
from gsbridge.tasks.episode import FORCES, Episode, write_episode
from gsbridge.tasks.state import State
from gsbridge.tasks.views import write_states

SHOWN = ("gs", "mesh", "mesh_vertex")
"""Renderers whose pictures the recording shows side by side."""


def play(
    environment: PickEnvironment,
    controller: Callable[[State], Array],
    eyes: Mapping[str, Eye],
    *,
    period: float,
    pose_set: str = "fixed",
    index: int = 0,
) -> Episode:
    """Let a controller act until the episode ends.

    Args:
        environment: Environment in any world.
        controller: Maps the privileged states of N worlds to actions [N, 5].
        eyes: Eyes that take the recorded pictures, by name; they look at the environment's world in addition to its own eye.
        period: Length of one step, s.
        pose_set: Name of a set of start poses.
        index: Start pose in it, and seed of the episode.
    """
    observation, info = environment.reset(seed=index, options={"pose_set": pose_set, "index": index})
    for eye in eyes.values():
        eye.begin(index)
    rows = [_row(environment, observation, info, eyes)]
    actions, rewards, over = [], [], False
    while not over:
        action = controller(state_of(info))[0]
        observation, reward, terminated, truncated, info = environment.step(action)
        rows.append(_row(environment, observation, info, eyes))
        actions.append(action)
        rewards.append(float(reward))
        over = terminated or truncated
    columns = {name: np.stack([row[name] for row in rows]) for name in rows[0] if name not in ("terms", "images")}
    return Episode(
        task=environment.settings.task,
        start=index,
        start_pose=np.asarray(info["start_pose"], dtype=np.float64),
        time=period * np.arange(len(rows)),
        names=tuple(environment.world.body_poses()),
        actions=np.stack(actions),
        rewards=np.array(rewards),
        terms={name: np.array([row["terms"][name] for row in rows]) for name in rows[0]["terms"]},
        images={name: np.stack([row["images"][name] for row in rows]) for name in eyes},
        **columns,
    )


def _row(
    environment: PickEnvironment, observation: Mapping[str, Array], info: Mapping[str, Any], eyes: Mapping[str, Eye]
) -> dict[str, Any]:
    """Return the fields of `Episode` for one state, without their first axis."""
    world, state = environment.world, state_of(info)
    return {
        "joints": world.joints()[0][:7].copy(),
        "aperture": state.aperture[0],
        "poses": np.stack(list(world.body_poses().values())),
        "cam_from_table": world.camera_pose(),
        "forces": np.array([*state.pad_forces[0], state.robot_contact[0], state.object_contact[0]]),
        "clearance": state.object_clearance[0],
        "proprio": observation["proprio"],
        "success": info["success"],
        "success_tolerant": info["success_tolerant"],
        "failure": info["failure"],
        "terms": info["terms"],
        "images": {name: eye.look(world) for name, eye in eyes.items()},
    }


def play_episode(
    files: StageFiles,
    settings: EnvironmentSettings,
    out: str | Path,
    states: str | Path,
    record: str | Path,
    *,
    pose_set: str = "fixed",
    index: int = 0,
) -> None:
    """Play one episode in the simulated world and write it.

    Args:
        files: What the environment is made of.
        settings: Settings of the environment; its renderer is replaced by each in turn.
        out: The episode, `.npz`, with pictures of all renderers.
        states: File of the states, without anything that only the simulated world knows, so that cameras of other worlds can
            show them (`gsbridge.tasks.views`).
        record: Record of the stage; degraded when the controller did not succeed.
        pose_set: Name of a set of start poses.
        index: Start pose in it.

    Raises:
        InputError: A file is missing or of the wrong kind.
    """
    model, response, lens = read_model(files.model), camera_response(files), lens_of(files, settings)
    eyes = {name: DrawnEye(build_renderer(files, replace(settings, renderer=name)), response, lens) for name in SHOWN}
    environment = build_environment(files, replace(settings, renderer="mesh"))
    try:
        controller = build_controller(files.item, settings)
        episode = play(environment, controller, eyes, period=model.period, pose_set=pose_set, index=index)
    finally:
        environment.close()
    write_episode(out, episode)
    write_states(states, episode.states(), pose_set)
    success, failure = bool(episode.success[-1]), str(episode.failure[-1])
    write_stage(
        record,
        reasons=[] if success else [f"the controller did not succeed: {failure}"],
        seed=index,
        packages=("pybullet", "numba"),
        task=episode.task,
        pose_set=pose_set,
        start=index,
        steps=len(episode) - 1,
        seconds=float(episode.time[-1]),
        success=success,
        failure=failure,
        largest_force=dict(zip(FORCES, episode.forces.max(0), strict=True)),
        image_size=settings.image_size,
        renderers=list(SHOWN),
    )
