"""Trials: a policy or a controller in any world, once from every start pose of a set."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from gsbridge.environment.controllers import GraspController
from gsbridge.environment.env import PickEnvironment, state_of
from gsbridge.environment.rendering import BlankRenderer
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.errors import InputError
from gsbridge.files import write_stage
from gsbridge.geometry import Array
from gsbridge.logs import ProgressLog
from gsbridge.tasks.poses import PER_QUADRANT, POSES, QUADRANTS
from gsbridge.tasks.world import World

Policy = Callable[[Mapping[str, Array], Mapping[str, Any]], Array]
"""Gives an action for an observation and its `info`; a policy that acts on the picture must not look into `info`."""


@dataclass(frozen=True)
class TrialResult:
    """One episode from one start pose.

    Args:
        seed: Seed of the set of poses.
        index: Number in the set; eight per quadrant, quadrant 1 first.
        start: x, y, yaw of the object, m, rad. [3].
        success: Whether it succeeded by the rules of the task.
        success_tolerant: Whether it succeeded when excess contact is forgiven.
        failure: Why it failed; empty for a success.
        steps: Control periods until the end.
        refused: Commands that the arm could not reach.
        clipped: Commands cut to the workspace.
        end: Why the episode ended on an arm, a word of `gsbridge.policy.safety.End`; empty in an environment.
    """

    seed: int
    index: int
    start: tuple[float, float, float]
    success: bool
    success_tolerant: bool
    failure: str
    steps: int
    refused: int
    clipped: int
    end: str = ""

    @property
    def quadrant(self) -> int:
        """Quadrant of the start pose, 1 to 4."""
        return QUADRANTS[self.index // PER_QUADRANT]


def spread(count: int) -> list[int]:
    """Choose `count` of the 32 poses of a set, evenly over the quadrants.

    Raises:
        InputError: The set has fewer poses.
    """
    if not 1 <= count <= POSES:
        raise InputError("trials: poses", f"{count} is out of range", f"Give 1 to {POSES}")
    return [(POSES * k) // count for k in range(count)]


def run_trial(environment: PickEnvironment, policy: Policy, pose_set: str, index: int) -> TrialResult:
    """Play one episode until it ends. Its random numbers come from the index and the settings' seed of poses.

    Args:
        environment: World to run the episode in; it is reset.
        policy: The policy or controller that acts.
        pose_set: Name of the set of start poses.
        index: Number of the start pose in the set.
    """
    seed = environment.settings.pose_seed
    observation, info = environment.reset(seed=1000 * seed + index, options={"pose_set": pose_set, "index": index})
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = environment.step(policy(observation, info))
        ended = terminated or truncated
    refused, clipped = int(info["refused"]), int(info["clipped"])
    x, y, yaw = (float(value) for value in info["start_pose"])
    return TrialResult(
        seed, index, (x, y, yaw), info["success"], info["success_tolerant"], info["failure"], info["steps"], refused, clipped
    )


def try_controller(
    world: World,
    controller: GraspController,
    settings: EnvironmentSettings,
    record: str | Path,
    *,
    name: str,
    seeds: Sequence[int],
    poses: int = POSES,
    pose_set: str = "fixed",
) -> list[TrialResult]:
    """Let a baseline controller work without pictures, and write how often it succeeds.

    Args:
        world: Any world.
        controller: Controller of the settings' task.
        settings: Settings of the environment.
        record: Record of the stage, with every trial.
        name: The world's name, for the record.
        seeds: Seeds of sets of start poses.
        poses: Poses of each set, evenly over the quadrants.
        pose_set: `fixed` or `unseen`.

    Raises:
        InputError: Too many poses.
    """
    trials: list[TrialResult] = []
    chosen = spread(poses)
    progress = ProgressLog(len(seeds) * len(chosen), "trials")
    for seed in seeds:
        environment = PickEnvironment(
            world, replace(settings, pose_seed=seed), BlankRenderer(settings.image_size), stroke=controller.stroke
        )
        for index in chosen:
            trials.append(run_trial(environment, lambda _, info: controller(state_of(info))[0], pose_set, index))
            progress.update()
    write_trials(record, trials, settings.task, name=name, pose_set=pose_set)
    return trials


def write_trials(
    record: str | Path,
    trials: Sequence[TrialResult],
    task: str,
    *,
    name: str,
    pose_set: str,
    facts: Mapping[str, Any] | None = None,
) -> None:
    """Write how often a baseline controller succeeds.

    Args:
        record: Record of the stage, with every trial.
        trials: Outcomes of the trials, equally many of each seed.
        task: `grasp` or `pick_and_place`.
        name: The world's name.
        pose_set: `fixed` or `unseen`.
        facts: Further entries of the record.
    """
    seeds = list(dict.fromkeys(trial.seed for trial in trials))
    counts = {
        name: {str(seed): sum(getattr(trial, name) for trial in trials if trial.seed == seed) for seed in seeds}
        for name in ("success", "success_tolerant")
    }
    failures = sorted({trial.failure for trial in trials if not trial.success})
    lost = sum(not trial.success for trial in trials)
    write_stage(
        record,
        reasons=[f"{lost} of {len(trials)} trials failed: {', '.join(failures)}"] if lost else [],
        packages=("pybullet", "mujoco"),
        world=name,
        task=task,
        pose_set=pose_set,
        poses=len({trial.index for trial in trials}),
        seeds=seeds,
        counts=counts,
        trials=[{**asdict(trial), "quadrant": trial.quadrant} for trial in trials],
        **(facts or {}),
    )
