"""Trials on an arm: in every world but the simulated one, trials use the same code path as `gsbridge run-policy`.

The policy sees pictures and what the arm measures: joint angles with their noise and offsets, turned into a tool pose by
forward kinematics and into the table's frame by the registration. Its commands go back the same way. Only the referee knows the
true state: it judges, and it ends the episode at a success. The states that it saw are the trial's log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gsbridge.environment.controllers import GraspController
from gsbridge.environment.policy_trials import path_row
from gsbridge.environment.rendering import wrist_camera
from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.environment.trial_log import TrialPath, encode
from gsbridge.environment.trials import TrialResult, spread, write_trials
from gsbridge.geometry import Array, quat_from_rotation
from gsbridge.logs import ProgressLog
from gsbridge.policy.episode_log import EpisodeLog
from gsbridge.policy.format import ACTION_NAMES
from gsbridge.policy.interface import PolicyInterface
from gsbridge.policy.runner import Policy, Setup, run_policy
from gsbridge.policy.safety import End, Limits
from gsbridge.policy.worlds import MirrorDriver, WorldDriver, episode_seed, world_seed
from gsbridge.reality.world.mirror import MirrorWorld
from gsbridge.reality.world.physics import MirrorPhysics
from gsbridge.registration.result import Registration
from gsbridge.robot.limits import Workspace
from gsbridge.tasks.poses import POSES
from gsbridge.tasks.poses import pose_set as poses_of
from gsbridge.tasks.world import CONTROL_HZ


class ArmTrials:
    """Plays trials of one policy on one world's arm; see `gsbridge.environment.policy_trials.run_trials`.

    Args:
        world: The mirror, or its physics alone.
        registration: Registered poses of table and camera.
        interface: Inputs and outputs of the policy.
        policy: The policy that acts.

    Raises:
        InputError: Registration, camera and policy do not belong together.
    """

    def __init__(
        self, world: MirrorWorld | MirrorPhysics, registration: Registration, interface: PolicyInterface, policy: Policy
    ) -> None:
        self.driver, self.policy = MirrorDriver(world, registration, interface.settings), policy
        self.setup = arm_setup(self.driver, registration, interface)

    def __call__(self, pose_set: str, index: int, seed: int) -> tuple[TrialResult, TrialPath]:
        """Play the trial that `PickEnvironment.reset` would begin with `seed`."""
        trial, path, _ = play_on_arm(
            self.policy, self.setup, self.driver, pose_set, index, world_seed(self.setup.interface.settings, seed)
        )
        return trial, path


def arm_setup(driver: WorldDriver, registration: Registration, interface: PolicyInterface) -> Setup:
    """Make the setup of a world's arm, with the world's own clock and without the check for equal pictures.

    Args:
        driver: The world as an arm.
        registration: Registered poses of table and camera.
        interface: Inputs and outputs of the policy.

    Raises:
        InputError: Registration, camera and policy do not belong together.
    """
    return Setup(interface, driver, registration, driver.clock, Limits(frozen=None))


def play_on_arm(
    policy: Policy, setup: Setup, driver: WorldDriver, pose_set: str, index: int, seed: int, *, steps: int | None = None
) -> tuple[TrialResult, TrialPath, End]:
    """Play one trial until it ends.

    Args:
        policy: The policy that acts.
        setup: The arm, with the driver.
        driver: The world.
        pose_set: Name of a set of start poses.
        index: Start pose in it.
        seed: Seed of what is random in the world.
        steps: See `run_policy`.

    Returns:
        Outcome, true path, and why the episode ended.

    Raises:
        InputError: See `run_policy`.
    """
    settings, referee = setup.interface.settings, driver.referee
    start = poses_of(pose_set, settings.region(), settings.pose_seed)[index]
    driver.prepare(start, seed)
    log = run_policy(policy, setup, steps=steps, until=referee, log=EpisodeLog(keep_pictures=True))
    if len(referee.states) <= log.steps:
        # A guard ended the episode before the referee was asked.
        referee()
    verdict = referee.verdict
    x, y, yaw = (float(value) for value in start)
    trial = TrialResult(
        settings.pose_seed, index, (x, y, yaw), verdict.success, verdict.success_tolerant, verdict.failure, log.steps,
        log.refused, log.clipped, log.end.value,
    )  # fmt: skip
    return trial, _path(log, driver, pose_set, index), log.end


def _path(log: EpisodeLog, driver: WorldDriver, pose_set: str, index: int) -> TrialPath:
    """Return the path of states that the referee saw, with actions and pictures."""
    states = driver.referee.states
    columns = [np.stack(column) for column in zip(*(path_row(state) for state in states), strict=True)]
    actions = np.zeros((len(states), len(ACTION_NAMES)), np.float32)
    if log.rows:
        actions[: log.steps] = np.stack([log.column(f"action_{name}") for name in ACTION_NAMES], axis=1)
    pictures = log.pictures if len(log.pictures) == len(states) else [*log.pictures, driver.image()]
    # The columns are the fields between `index` and `actions`.
    return TrialPath(pose_set, index, *columns, actions=actions, jpegs=tuple(map(encode, pictures)))  # type: ignore[misc,arg-type]


class SeeingController:
    """The baseline controller in the role of a policy on an arm.

    It gets the true pose and contacts of the object, as from perfect sensors, but only the measured pose of its own arm.

    Args:
        controller: The controller.
        driver: The arm.
        base_from_table: Registered pose of the table. [4, 4].
    """

    def __init__(self, controller: GraspController, driver: WorldDriver, base_from_table: Array) -> None:
        self.controller, self.driver = controller, driver
        self._table_from_base = np.linalg.inv(base_from_table)

    def __call__(self, observation: Mapping[str, Array], info: Mapping[str, object]) -> Array:
        """The action. [5]."""
        reading = self.driver.reading
        if reading is None:  # asked before the episode begins
            return np.zeros(len(ACTION_NAMES))
        pose = self._table_from_base @ reading.base_from_tool
        believed = replace(
            self.driver.referee.states[-1],
            tool_position=pose[None, :3, 3],
            tool_quat=quat_from_rotation(pose[:3, :3])[None],
            aperture=np.array([reading.aperture]),
        )
        return self.controller(believed)[0]


def try_controller_on_arm(
    world: MirrorPhysics,
    registration: Registration,
    controller: GraspController,
    settings: EnvironmentSettings,
    record: str | Path,
    *,
    name: str,
    seeds: Sequence[int],
    poses: int = POSES,
    pose_set: str = "fixed",
) -> list[TrialResult]:
    """Let a baseline controller work on an arm without pictures, and write how often it succeeds.

    Args:
        world: The mirror's physics.
        registration: Registered pose of the table.
        controller: Controller of the settings' task.
        settings: Settings of the environment.
        record: Record of the stage, with every trial.
        name: The world's name, for the record.
        seeds: Seeds of sets of start poses.
        poses: Poses of each set, evenly over the quadrants.
        pose_set: Name of a set of start poses.

    Raises:
        InputError: Too many poses.
    """
    trials: list[TrialResult] = []
    ends: dict[str, int] = {}
    chosen = spread(poses)
    progress = ProgressLog(len(seeds) * len(chosen), "trials")
    for seed in seeds:
        own = replace(settings, pose_seed=seed)
        driver = MirrorDriver(world, registration, own)
        camera = wrist_camera(own.image_size)
        interface = PolicyInterface(camera, Workspace.around(), controller.stroke, own, CONTROL_HZ)
        setup = arm_setup(driver, registration, interface)
        acting = SeeingController(controller, driver, registration.base_from_table)
        for index in chosen:
            trial, _, end = play_on_arm(acting, setup, driver, pose_set, index, episode_seed(own, index))
            trials.append(trial)
            ends[end.value] = ends.get(end.value, 0) + 1
            progress.update()
    write_trials(record, trials, settings.task, name=name, pose_set=pose_set, facts={"ends": dict(sorted(ends.items()))})
    return trials
