"""Checks of a simulated world as a whole: against another engine, and against itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gsbridge.environment.build import StageFiles, build_controller, build_world, plate_of
from gsbridge.environment.env import PickEnvironment, state_of
from gsbridge.environment.rendering import BlankRenderer
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.files import write_stage
from gsbridge.geometry import Array
from gsbridge.robot.assembly import RobotFiles
from gsbridge.sim.twin import compare_with_twin

MOST_APART = 0.003
"""Largest distance of the tool points of two engines in free motion, m."""


def trajectory(files: StageFiles, seed: int) -> Array:
    """One grasp by the baseline controller, in a world built anew: what moved, step by step. [T, M]."""
    settings = EnvironmentSettings(image_size=64, plate=plate_of(files.item, files.background))
    with build_world(files) as world:
        environment = PickEnvironment(world, settings, BlankRenderer(64), stroke=world.dimensions.stroke)
        controller = build_controller(files.item, settings)
        _, info = environment.reset(seed=seed)
        rows, ended = [], False
        while not ended:
            *_, terminated, truncated, info = environment.step(controller(state_of(info))[0])
            poses = np.concatenate([pose.ravel() for pose in world.body_poses().values()])
            rows.append(np.concatenate([*world.joints(), poses, np.concatenate([v.ravel() for v in info["state"].values()])]))
            ended = terminated or truncated
    return np.array(rows)


def check_simulator(files: StageFiles, record: str | Path, *, seed: int = 0) -> None:
    """Compare the arm's free motion with the MuJoCo twin's, and one episode with its repetition in a second world.

    Args:
        files: What the world is made of.
        record: Record of the stage.
        seed: Of the repeated episode.

    Raises:
        InputError: As `build_world`.
    """
    with build_world(files) as world:
        apart = compare_with_twin(RobotFiles.read(files.robot), world)
    first, second = (trajectory(files, seed) for _ in range(2))
    same = first.shape == second.shape and first.tobytes() == second.tobytes()
    reasons = [] if same else ["an episode repeated with the same seed differs"]
    if apart.tool > MOST_APART:
        reasons.append(f"the tool of another engine is {1e3 * apart.tool:.2f} mm away in free motion")
    write_stage(
        record,
        reasons=reasons,
        seed=seed,
        packages=("pybullet", "mujoco"),
        twin={"tool_mm": 1e3 * apart.tool, "joints_deg": float(np.rad2deg(apart.joints)), "travel": apart.travel},
        repeated={"identical": same, "steps": len(first)},
    )
