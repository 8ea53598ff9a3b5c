"""Settings of a training, checked when they are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gsbridge.environment.settings import IMAGE_SIZES
from gsbridge.errors import InputError

ALGORITHMS = ("sacwb", "sac", "bc", "dagger")
TARGETS = ("official", "paper", "none")
DEVICES = ("cpu", "cuda")

RETURN_BOUND = 1.0
"""Largest return of an episode: one reward of 1, at its end."""

MAX_ALPHA_START = 1.0

_NUMBERS = {
    "updates_per_step": (0.01, 8.0),
    "learning_rate": (1e-6, 0.1),
    "tau": (1e-4, 1.0),
    "averaging": (1e-4, 1.0),
    "gamma": (0.5, 0.9999),
    "alpha_start": (1e-6, MAX_ALPHA_START),
    "alpha_cap": (1e-6, MAX_ALPHA_START),
    "alpha_rate": (0.0, 0.1),
    "target_entropy": (-50.0, 5.0),
    "lambda_floor": (0.0, 1.0),
    "lambda_share": (0.01, 1.0),
    "position_weight": (0.0, 100.0),
    "bc_weight": (0.0, 100.0),
    "q_weight": (0.0, 100.0),
    "base_noise": (0.0, 1.0),
}
_COUNTS = {
    "steps": (1, 10_000_000),
    "start_steps": (1, 1_000_000),
    "actor_batch": (2, 4096),
    "critic_batch": (2, 4096),
    "replay_capacity": (200, 10_000_000),
    "eval_every": (1, 1_000_000),
    "eval_poses": (4, 1024),
    "stop_after": (0, 1000),
    "environments": (1, 256),
}
_SWITCHES = ("augment", "bounded_critic", "bf16")


@dataclass(frozen=True)
class PolicySettings:
    """How a policy learns. The defaults are the standard cell on one CPU thread.

    Args:
        algo: `sacwb` (SAC with baseline controller, the paper's), `sac` (no controller), `bc` (imitates the controller on its
            own episodes) or `dagger` (imitates it on the policy's episodes, too).
        target: Critic target of `sacwb`: `official` (maximum of both branches, one entropy term), `paper` (the paper's
            equation; diverges for large alpha) or `none` (no maximum); see `gsbridge.policy.losses`.
        image_size: Edge of the picture, px; the environment's.
        steps: Environment steps of the whole training.
        start_steps: Steps before the first update; `sac` acts at random in them, the others follow the controller.
        updates_per_step: Gradient steps per environment step.
        actor_batch, critic_batch: Transitions per gradient step; the actor takes the first of the critics'.
        learning_rate: Of Adam, actor and critics.
        tau: Share of the critics that enters the target critics per update.
        averaging: Share of the actor that enters the averaged actor per update; the average is what is evaluated and delivered,
            1 takes the actor as it is. At a learning rate that learns within minutes, single weights swing by 30 points of
            success from one evaluation to the next.
        gamma: Discount per step.
        alpha_start, alpha_cap: Temperature at the start and its upper limit. From about 0.01 the entropy of an endless episode
            outweighs the reward of 1: alpha |H| / (1 - gamma) must stay well below it.
        alpha_rate: Step size of log alpha; 0 keeps it.
        target_entropy: Entropy that the temperature aims at, nats.
        lambda_floor, lambda_share: Share of the controller: from 1 straight down to the floor over this share of `steps`. At a
            floor of 0, as in the paper, nothing imitates where young critics err, and success fell from 81 % to 47 %.
        position_weight: Of the auxiliary loss on the object's position.
        bc_weight, q_weight: Of imitation and of the SAC loss in the actor's loss.
        base_noise: Standard deviation of noise on the controller's actions when they are carried out, never on labels.
        augment: Vary the colours of the pictures that the actor learns from, and add noise.
        bounded_critic: Squash Q to 0..1 by a sigmoid, as RL-GSBridge's code does.
        bf16: Compute the actor's gradients in bfloat16: twice as fast on processors with instructions for it, ten times slower
            on others.
        replay_capacity: Frames that the replay buffer holds.
        eval_every: Steps between two evaluations.
        eval_poses: Start poses of an evaluation, a multiple of 4.
        stop_after: Stop after so many evaluations in a row without a failure; 0 never stops early.
        environments: Environments that training episodes are played in at a time, a process each, so that the actor sees a
            batch of pictures. With several, an evaluation cuts the episodes that run when it begins.
        device: Where the networks are.

    Raises:
        InputError: A setting is unknown or out of range.
    """

    algo: str = "sacwb"
    target: str = "official"
    image_size: int = 64
    steps: int = 9_000
    start_steps: int = 300
    updates_per_step: float = 0.4
    actor_batch: int = 128
    critic_batch: int = 128
    learning_rate: float = 1e-3
    tau: float = 0.01
    averaging: float = 0.005
    gamma: float = 0.97
    alpha_start: float = 0.001
    alpha_cap: float = 0.01
    alpha_rate: float = 1e-3
    target_entropy: float = -5.0
    lambda_floor: float = 0.1
    lambda_share: float = 0.5
    position_weight: float = 1.0
    bc_weight: float = 1.0
    q_weight: float = 0.1
    base_noise: float = 0.1
    augment: bool = True
    bounded_critic: bool = False
    bf16: bool = False
    replay_capacity: int = 12_000
    eval_every: int = 1_000
    eval_poses: int = 32
    stop_after: int = 2
    environments: int = 1
    device: str = "cpu"

    def __post_init__(self) -> None:
        for name, allowed in (("algo", ALGORITHMS), ("target", TARGETS), ("image_size", IMAGE_SIZES), ("device", DEVICES)):
            value = getattr(self, name)
            if isinstance(value, bool) or value not in allowed:
                raise _wrong(name, value, f"Use one of {', '.join(map(str, allowed))}")
        for name, (low, high) in _COUNTS.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
                raise _wrong(name, value, f"Give a whole number from {low} to {high}")
        for name, (least, most) in _NUMBERS.items():
            value = getattr(self, name)
            number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            if not number or not least <= value <= most:
                raise _wrong(name, value, f"Give {least:g} to {most:g}")
        for name in _SWITCHES:
            if not isinstance(getattr(self, name), bool):
                raise _wrong(name, getattr(self, name), "Give true or false")
        if self.critic_batch < self.actor_batch:
            raise _wrong("critic_batch", self.critic_batch, f"Give at least the actor's {self.actor_batch}")
        if self.alpha_start > self.alpha_cap:
            raise _wrong("alpha_start", self.alpha_start, f"Give at most alpha_cap, {self.alpha_cap:g}")
        if self.eval_poses % 4:
            raise _wrong("eval_poses", self.eval_poses, "Give a multiple of 4: as many in each quadrant")

    @property
    def has_critics(self) -> bool:
        """Whether the algorithm learns a value."""
        return self.algo in ("sacwb", "sac")

    @property
    def has_controller(self) -> bool:
        """Whether the algorithm follows or imitates a controller."""
        return self.algo != "sac"

    @property
    def maximum(self) -> str:
        """Critic target in use: `sac` has no controller to take the maximum with."""
        return self.target if self.algo == "sacwb" else "none"

    def lambda_at(self, step: int) -> float:
        """Share of the controller at an environment step, 0..1; 1 for `bc` and 0 for `sac` throughout."""
        if self.algo in ("bc", "sac"):
            return float(self.algo == "bc")
        done = min(1.0, step / (self.lambda_share * self.steps))
        return 1.0 - (1.0 - self.lambda_floor) * done


def _wrong(name: str, value: Any, remedy: str) -> InputError:
    return InputError(f"policy: {name}", f"{value!r} is out of range", remedy)
