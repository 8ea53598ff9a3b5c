"""A series of episodes with one arm: place, run, judge, record."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gsbridge.environment.settings import EnvironmentSettings
from gsbridge.policy.driver import hold
from gsbridge.policy.episode_log import EpisodeLog, write_episode
from gsbridge.policy.robot_trials import StartPose, TrialFile, Verdict
from gsbridge.policy.runner import Policy, Setup, run_policy
from gsbridge.policy.worlds import WorldDriver, world_seed
from gsbridge.tasks.poses import trial_seed

logger = logging.getLogger("gsbridge")


class Operator(Protocol):
    """Sets up and judges episodes: a person, or a world's referee."""

    def place(self, pose: StartPose) -> None:
        """Have the object placed at the start pose, and nobody near the arm."""

    def over(self) -> bool:
        """Whether the episode is to end early; asked after each step."""

    def judge(self, log: EpisodeLog) -> Verdict | None:
        """Judge the trial that has ended; None if it does not count and is to be repeated."""


class WorldOperator:
    """Places objects in a world and judges by its referee.

    Args:
        driver: The world.
        settings: Settings of the policy's environment.
    """

    def __init__(self, driver: WorldDriver, settings: EnvironmentSettings) -> None:
        self.driver, self.settings = driver, settings

    def place(self, pose: StartPose) -> None:
        """See `Operator`."""
        self.driver.prepare(
            np.array([pose.x, pose.y, pose.yaw]), world_seed(self.settings, trial_seed(pose.pose_set, pose.index))
        )

    def over(self) -> bool:
        """See `Operator`."""
        return self.driver.referee()

    def judge(self, log: EpisodeLog) -> Verdict:
        """See `Operator`."""
        referee = self.driver.referee
        if len(referee.states) <= log.steps:
            # A guard ended the episode before the referee was asked.
            referee()
        return referee.verdict


@dataclass(frozen=True)
class Plan:
    """Episodes to run, and where their results go.

    Args:
        poses: Start poses; empty for one episode from wherever the object lies, which is no trial and is not judged.
        out: Folder of the episodes' logs; None for no logs.
        trials: File to add trials to; None to add them to none.
        steps: Steps of an episode; None for as many as in the training.
        dry_run: Whether to give no commands and to judge nothing.
        pictures: Whether to keep the pictures in the logs.
    """

    poses: Sequence[StartPose] = ()
    out: Path | None = None
    trials: TrialFile | None = None
    steps: int | None = None
    dry_run: bool = False
    pictures: bool = False


def run_session(
    policy: Policy, setup: Setup, operator: Operator, plan: Plan, facts: Mapping[str, Any]
) -> list[tuple[EpisodeLog, Verdict | None]]:
    """Run episodes one after the other; the log and the trial's row of each are written before the next begins.

    Args:
        policy: The policy that acts.
        setup: The arm.
        operator: Places the object and judges.
        plan: Episodes to run, and where their results go.
        facts: Entries of every log on policy, driver and registration.

    Returns:
        Log and verdict of each episode, in order; the verdict is None if the episode was not judged or did not count.

    Raises:
        InputError: As `run_policy`; the log up to the error is written.
    """
    done: list[tuple[EpisodeLog, Verdict | None]] = []
    for pose in plan.poses or (None,):
        while True:
            log, verdict = _episode(policy, setup, operator, plan, pose, facts)
            done.append((log, verdict))
            if verdict is not None and plan.trials is not None and pose is not None:
                plan.trials.add(pose, verdict, log)
            if verdict is not None or pose is None or plan.dry_run:
                break
            logger.info("the trial does not count; once more")
    return done


def _episode(
    policy: Policy, setup: Setup, operator: Operator, plan: Plan, pose: StartPose | None, facts: Mapping[str, Any]
) -> tuple[EpisodeLog, Verdict | None]:
    """Place the object, run one episode, have it judged, and write its log."""
    log, verdict = EpisodeLog(keep_pictures=plan.pictures), None
    if pose is not None:
        _place(setup, operator, pose)
    try:
        run_policy(policy, setup, steps=plan.steps, dry_run=plan.dry_run, until=operator.over, log=log)
        if pose is not None and not plan.dry_run:
            verdict = operator.judge(log)
    finally:
        if plan.out is not None:
            start = None if pose is None else {**vars(pose), "quadrant": pose.quadrant}
            judged = None if verdict is None else vars(verdict)
            doubts = [f"the registration is degraded: {reason}" for reason in setup.registration.reasons]
            write_episode(_free_stem(plan.out, pose), log, doubts, start_pose=start, verdict=judged, **facts)
    name = "episode" if pose is None else f"{pose.pose_set} {pose.index}"
    outcome = "not judged" if verdict is None else "success" if verdict.success else f"no success {verdict.failure}".rstrip()
    logger.info("%s: %s after %d steps (%s), %d late", name, outcome, log.steps, log.end.value, log.overruns)
    return log, verdict


def _place(setup: Setup, operator: Operator, pose: StartPose) -> None:
    """Have the object placed; stop the arm, which may move for this, after an error."""
    try:
        operator.place(pose)
    except BaseException:
        hold(setup.driver)
        raise


def _free_stem(folder: Path, pose: StartPose | None) -> Path:
    """Return a path that no earlier episode has, so that nothing is overwritten."""
    name = "episode" if pose is None else f"{pose.pose_set}_{pose.index:02d}"
    number = 1
    while (folder / (name if number == 1 else f"{name}_{number}")).with_suffix(".json").exists():
        number += 1
    return folder / (name if number == 1 else f"{name}_{number}")
