"""Evaluation of a policy during its training, from random start poses that belong to none of the test sets.

The test sets are not used before the training is over: the best weights are chosen by an evaluation, and results on the poses
of that choice would be too good.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from gsbridge.environment.env import DrawnEye, PickEnvironment, state_of
from gsbridge.environment.rendering import BlankRenderer
from gsbridge.environment.trials import Policy
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.policy.observation import Controller
from gsbridge.tasks.poses import QUADRANTS, StartRegion

_TRIES = 1000

Value = Callable[[Mapping[str, Array], Mapping[str, Any]], float]
"""Function that returns the expected return after an observation and its `info`."""


@dataclass(frozen=True)
class Evaluation:
    """Outcome of episodes, one per start pose.

    Args:
        success: Whether each episode succeeded. bool [N].
        quadrant: Quadrant of the start pose, 1 to 4. [N].
        steps: Steps of each episode. [N].
        returns: Discounted return from the start. [N].
        expected: Return that the critics expected at the start; NaN without critics. [N].
    """

    success: Array
    quadrant: Array
    steps: Array
    returns: Array
    expected: Array

    @property
    def rate(self) -> float:
        """Share of successes."""
        return float(self.success.mean())

    def rate_in(self, quadrant: int) -> float:
        """Return the success rate from start poses in a quadrant; NaN if there are none."""
        inside = self.quadrant == quadrant
        return float(self.success[inside].mean()) if inside.any() else float("nan")


def evaluation_poses(region: StartRegion, count: int, seed: int, draw: int = 0) -> Array:
    """Draw random start poses, equally many in each quadrant.

    Args:
        region: Where objects start.
        count: Number of poses, a multiple of 4.
        seed: Seed of the training.
        draw: 0 for the set by which weights are chosen, 1 for the set that tests the choice.

    Returns:
        x, y, yaw, quadrant 1 first. [count, 3].

    Raises:
        InputError: A quadrant has no room.
    """
    rng = np.random.default_rng([seed, 3, draw])
    wanted = count // len(QUADRANTS)
    found: dict[int, list[Array]] = {quadrant: [] for quadrant in QUADRANTS}
    for _ in range(_TRIES):
        for pose in region.sample(rng, 8):
            rows = found[int(region.quadrant(pose[:2]))]
            if len(rows) < wanted:
                rows.append(pose)
        if all(len(rows) == wanted for rows in found.values()):
            return np.concatenate([np.stack(rows) for rows in found.values()])
    raise InputError("start region", "a quadrant has no free place", "Move the plate or the region")


def evaluate(
    environment: gymnasium.Env, policy: Policy, poses: Array, seed: int, gamma: float, value: Value | None = None
) -> Evaluation:
    """Play one episode from each pose.

    Args:
        environment: A `PickEnvironment`, wrapped or not.
        policy: The policy that acts.
        poses: x, y, yaw of the object, m and rad. [N, 3].
        seed: Seed of what is random in the episodes.
        gamma: Discount per step.
        value: Estimates the return from the start; None to leave this out.
    """
    rows = []
    for k, pose in enumerate(poses):
        observation, info = environment.reset(seed=episode_seed(seed, 1, k), options={"pose": pose})
        expected = float("nan") if value is None else value(observation, info)
        total, discount, ended = 0.0, 1.0, False
        while not ended:
            observation, reward, terminated, truncated, info = environment.step(policy(observation, info))
            total += discount * float(reward)
            discount *= gamma
            ended = terminated or truncated
        rows.append((info["success"], info["steps"], total, expected))
    success, steps, returns, expectations = (np.array(column) for column in zip(*rows, strict=True))
    quadrant = bare(environment).region.quadrant(poses[:, :2])
    return Evaluation(success.astype(bool), quadrant, steps, returns, expectations)


def evaluate_controller(environment: gymnasium.Env, controller: Controller, poses: Array, seed: int) -> Evaluation:
    """Play one episode of a baseline controller from each pose, without drawing the pictures, which it does not use.

    Args:
        environment: A `PickEnvironment`, wrapped or not.
        controller: The controller that acts.
        poses: x, y, yaw of the object, m and rad. [N, 3].
        seed: Seed of what is random in the episodes.
    """
    with _blind(bare(environment)):
        return evaluate(environment, lambda _, info: controller(state_of(info))[0], poses, seed, 1.0)


def episode_seed(seed: int, stream: int, number: int) -> int:
    """Seed of one episode. Every episode has its own, so that a training resumes from counters alone.

    Args:
        seed: Seed of the training.
        stream: 0 for training, 1 for evaluation.
        number: Number of the episode.
    """
    return int(np.random.SeedSequence([seed, stream, number]).generate_state(1)[0] >> 1)


def bare(environment: gymnasium.Env) -> PickEnvironment:
    """The environment inside its wrappers.

    Raises:
        InputError: It is another environment.
    """
    inside = environment.unwrapped
    if not isinstance(inside, PickEnvironment):
        raise InputError("training", f"a {type(inside).__name__} is no PickEnvironment", "Build the environment from its files")
    return inside


@contextlib.contextmanager
def _blind(environment: PickEnvironment) -> Iterator[None]:
    """Let the environment draw no pictures inside a block."""
    eye = environment.eye
    environment.eye = DrawnEye(BlankRenderer(environment.settings.image_size))
    try:
        yield
    finally:
        environment.eye = eye
