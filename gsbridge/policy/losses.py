"""Targets and losses of SACwB, as pure functions of tensors; everything per transition is [B].

With a' drawn from the actor at the next state s', b' the baseline controller's action there, q = min Q of the target critics:

| target | y |
|---|---|
| `official` | r + gamma (1 - d) (max(q(a'), q(b')) - alpha log pi(a')) |
| `paper` | r + gamma (1 - d) max(q(a') - alpha log pi(a'), q(b') - alpha log pi(b')) |
| `plain` | r + gamma (1 - d) (q(a') - alpha log pi(a')): soft actor-critic |

The paper prints `paper`, its code computes `official`, and the two differ greatly. A controller saturates, and at a saturated
action log pi(b') falls without bound as the actor grows confident. In `paper`, the entropy bonus for this action, which the
actor does *not* take, then outweighs the reward, and targets exceed the largest return, which is 1, many times over. The paper
prints no terminal mask d either; its code has one.
"""

from __future__ import annotations

import logging

import torch
from torch import Tensor

logger = logging.getLogger("gsbridge")


def official_target(
    reward: Tensor, terminated: Tensor, q_actor: Tensor, q_base: Tensor, log_prob_actor: Tensor, alpha: float, gamma: float
) -> Tensor:
    """Critic target of RL-GSBridge's code; see the module's table.

    Args:
        reward: r. [B].
        terminated: d, 1 where the episode ended in s'. [B].
        q_actor, q_base: min Q of the actor's and of the controller's action at s'. [B].
        log_prob_actor: log pi of the actor's action. [B].
        alpha: Temperature.
        gamma: Discount per step.

    Returns:
        y. [B].
    """
    value = torch.maximum(q_actor, q_base) - alpha * log_prob_actor
    return reward + gamma * (1.0 - terminated) * value


def paper_target(
    reward: Tensor,
    terminated: Tensor,
    q_actor: Tensor,
    q_base: Tensor,
    log_prob_actor: Tensor,
    log_prob_base: Tensor,
    alpha: float,
    gamma: float,
) -> Tensor:
    """Critic target of the paper's equation; see the module's table.

    Args:
        reward: r. [B].
        terminated: d, 1 where the episode ended in s'. [B].
        q_actor, q_base: min Q of the actor's and of the controller's action at s'. [B].
        log_prob_actor: log pi of the actor's action. [B].
        log_prob_base: log pi of the controller's action, which must be cut before tanh^-1. [B].
        alpha: Temperature.
        gamma: Discount per step.

    Returns:
        y. [B].
    """
    value = torch.maximum(q_actor - alpha * log_prob_actor, q_base - alpha * log_prob_base)
    return reward + gamma * (1.0 - terminated) * value


def plain_target(
    reward: Tensor, terminated: Tensor, q_actor: Tensor, log_prob_actor: Tensor, alpha: float, gamma: float
) -> Tensor:
    """Critic target of soft actor-critic, without the controller; see the module's table.

    Args:
        reward: r. [B].
        terminated: d, 1 where the episode ended in s'. [B].
        q_actor: min Q of the actor's action at s'. [B].
        log_prob_actor: log pi of that action. [B].
        alpha: Temperature.
        gamma: Discount per step.

    Returns:
        y. [B].
    """
    return reward + gamma * (1.0 - terminated) * (q_actor - alpha * log_prob_actor)


def critic_loss(first: Tensor, second: Tensor, target: Tensor) -> Tensor:
    """Sum of both critics' mean squared errors.

    Args:
        first, second: Q of the taken action by each critic. [B].
        target: y. [B].
    """
    return ((first - target) ** 2).mean() + ((second - target) ** 2).mean()


def soft_loss(q_actor: Tensor, log_prob: Tensor, alpha: float) -> Tensor:
    """The actor's loss in soft actor-critic: mean of alpha log pi - min Q.

    Args:
        q_actor: min Q of the actor's action. [B].
        log_prob: log pi of that action. [B].
        alpha: Temperature.
    """
    return (alpha * log_prob - q_actor).mean()


def imitated(q_base: Tensor, q_actor: Tensor, coin: Tensor, share: float) -> Tensor:
    """Mark imitated transitions: each with probability lambda, and all those in which the controller's action has the larger Q.

    Args:
        q_base, q_actor: min Q of the controller's and of the actor's action. [B].
        coin: Uniform draws 0..1, one per transition as the paper implies (its code draws one per batch). [B].
        share: lambda.

    Returns:
        1 where a transition is imitated, else 0. float [B].
    """
    return ((coin < share) | (q_base > q_actor)).float()


def imitation_loss(mode: Tensor, base: Tensor, mask: Tensor) -> Tensor:
    """Return the mean squared distance of the actor's mean action from the controller's, over the masked transitions.

    If the actor's action has the larger Q, the paper's argmax is the actor's own action, and the loss is zero. The sum is
    therefore divided by the size of the whole batch, and the loss fades as the actor gets better.

    Args:
        mode: tanh of the actor's mean. [B, 5].
        base: The controller's actions. [B, 5].
        mask: 1 where the controller is imitated, else 0. [B].
    """
    return (mask * ((mode - base) ** 2).mean(1)).mean()


def position_loss(guess: Tensor, label: Tensor) -> Tensor:
    """Mean squared error of the auxiliary head. [B, 3]."""
    return ((guess - label) ** 2).mean()


def temperature_loss(log_alpha: Tensor, log_prob: Tensor, target_entropy: float) -> Tensor:
    """Loss of log alpha, which rises while the entropy is below its target.

    Args:
        log_alpha: Logarithm of the temperature, the learnt parameter. [].
        log_prob: log pi of the actor's action; no gradient flows to it. [B].
        target_entropy: Wanted mean of -log pi, nats.
    """
    return -(log_alpha * (log_prob.detach() + target_entropy)).mean()


class TargetAlarm:
    """Watches critic targets, none of which can correctly exceed the largest return.

    Args:
        bound: Largest return.
        margin: Permitted overshoot, for critics early in the training.
    """

    def __init__(self, bound: float, margin: float = 0.1) -> None:
        self.bound, self.margin, self.count = bound, margin, 0

    def see(self, targets: Tensor) -> bool:
        """Check a batch of targets, and warn the first time that one is too large. [B].

        Returns:
            Whether one of them is beyond the bound, or not finite.
        """
        highest = float(targets.max())
        rung = not highest <= self.bound + self.margin
        if rung and self.count == 0:
            logger.warning(
                "a critic target of %.3g exceeds the largest return of %.3g; lower alpha, or use the official target",
                highest,
                self.bound,
            )
        self.count += rung
        return rung
