"""Checks of a simulated world as a whole: against another engine, and against itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gsbridge.environment.build import StageFiles, build_controller, build_world, plate_of
from gsbridge.environment.controllers import GraspController
from gsbridge.environment.env import PickEnvironment, state_of
from gsbridge.environment.rendering import BlankRenderer
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.files import write_stage
from gsbridge.geometry import Array
from gsbridge.robot.assembly import RobotFiles
from gsbridge.sim.twin import compare_with_twin

MOST_APART = 0.003
"""Largest permitted distance between the tool points of the two engines in free motion, m."""


HELD = 1.0
"""Force of each pad above which the object counts as held, N."""


def trajectory(environment: PickEnvironment, controller: GraspController, seed: int, *, until_held: bool = False) -> Array:
    """Record everything that moves in an episode of the baseline controller.

    Args:
        environment: World to run the episode in; it is reset.
        controller: The controller that acts.
        seed: Seed of the episode.
        until_held: Whether to stop once both pads hold the object, instead of at the episode's end.

    Returns:
        A row after each step: joint positions and speeds, poses of all bodies, and the state in `info`. [T, M].
    """
    world = environment.world
    _, info = environment.reset(seed=seed)
    rows: list[Array] = []
    ended = False
    while not ended:
        *_, terminated, truncated, info = environment.step(controller(state_of(info))[0])
        poses = np.concatenate([pose.ravel() for pose in world.body_poses().values()])
        rows.append(np.concatenate([*world.joints(), poses, np.concatenate([v.ravel() for v in info["state"].values()])]))
        ended = terminated or truncated or (until_held and info["state"]["pad_forces"].min() > HELD)
    return np.array(rows)


def repetitions(files: StageFiles, seed: int) -> list[Array]:
    """Play the same episode several times, in a used world and in a new one.

    The first world plays it twice in a row, then after an episode that broke off with the object in the hand, then after
    another episode; a new world plays it once more. Bullet keeps contacts from step to step. The hardest cases are an object
    that starts where it already is, and one that is still in the hand.
    """
    settings = EnvironmentSettings(image_size=64, plate=plate_of(files.item, files.background))
    controller, out = build_controller(files.item, settings), []
    for before in (("", "", "held", "another"), ("",)):
        with build_world(files) as world:
            environment = PickEnvironment(world, settings, BlankRenderer(64), stroke=world.dimensions.stroke)
            for episode in before:
                if episode:
                    trajectory(environment, controller, seed + (episode == "another"), until_held=episode == "held")
                out.append(trajectory(environment, controller, seed))
    return out


def check_simulator(files: StageFiles, record: str | Path, *, seed: int = 0) -> None:
    """Compare the arm's free motion with the MuJoCo twin's, and one episode with its repetitions.

    Args:
        files: What the world is made of.
        record: Record of the stage.
        seed: Seed of the repeated episode.

    Raises:
        InputError: As `build_world`.
    """
    with build_world(files) as world:
        apart = compare_with_twin(RobotFiles.read(files.robot), world)
    first, *others = repetitions(files, seed)
    same = all(first.shape == other.shape and first.tobytes() == other.tobytes() for other in others)
    reasons = [] if same else ["an episode repeated with the same seed differs"]
    if apart.tool > MOST_APART:
        reasons.append(f"the tool of another engine is {1e3 * apart.tool:.2f} mm away in free motion")
    write_stage(
        record,
        reasons=reasons,
        seed=seed,
        packages=("pybullet", "mujoco"),
        twin={"tool_mm": 1e3 * apart.tool, "joints_deg": float(np.rad2deg(apart.joints)), "travel": apart.travel},
        repeated={"identical": same, "steps": len(first), "repetitions": len(others)},
    )
