"""The agent: networks, optimisers and temperature; it acts, and it learns from batches.

Source: RL-GSBridge, "SAC with Baseline controller"; acting and imitation follow its code where paper and code differ, see
`gsbridge.policy.losses`.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gsbridge.configuration.policy import PolicySettings
from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.policy import losses
from gsbridge.policy.augment import Augmentation, Augmenter
from gsbridge.policy.networks import Actor, Critics, TanhGaussian
from gsbridge.policy.observation import TrainingState, picture
from gsbridge.policy.replay import Batch
from gsbridge.sim.actions import SIZE

_RETURN_BOUND = 1.0
"""Largest return of an episode: one reward of 1, at its end."""


@dataclass(frozen=True)
class Choice:
    """An action to carry out.

    Args:
        action: -1..1. float32 [5].
        by_actor: Whether the actor chose it, not the controller.
    """

    action: Array
    by_actor: bool


class Agent:
    """Networks, losses and optimisers of one training; see the module.

    Args:
        settings: Settings of the training.
        seed: Seed of the initial weights and of all random draws.
        device: Device of the networks; random numbers are drawn on the CPU, so that they are the same everywhere.
    """

    def __init__(self, settings: PolicySettings, seed: int, device: str = "cpu") -> None:
        self.settings, self.device = settings, device
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.actor = Actor().to(device)
            self.critics = Critics(bounded=settings.bounded_critic).to(device)
        self.target_critics = copy.deepcopy(self.critics).requires_grad_(False)
        self.averaged = copy.deepcopy(self.actor).requires_grad_(False)
        self.log_alpha = torch.tensor(math.log(settings.alpha_start), device=device, requires_grad=True)
        self.optimisers = {
            "actor": torch.optim.Adam(self.actor.parameters(), lr=settings.learning_rate, fused=True),
            "critics": torch.optim.Adam(self.critics.parameters(), lr=settings.learning_rate, fused=True),
            "alpha": torch.optim.Adam([self.log_alpha], lr=settings.alpha_rate),
        }
        # A random stream of its own, apart from that of the initial weights.
        self.generator = torch.Generator().manual_seed(seed + 2**32)
        self.augmenter = Augmenter(Augmentation().widened(settings.jitter), device=device) if settings.augment else None
        self.alarm = losses.TargetAlarm(_RETURN_BOUND)
        self.updates = 0

    @property
    def alpha(self) -> float:
        """Temperature of the entropy."""
        return float(self.log_alpha.detach().exp())

    @torch.no_grad()
    def act_all(self, states: Sequence[TrainingState], share: float) -> list[Choice]:
        """Choose an action in each of several states.

        With probability lambda it is the controller's action. Otherwise it depends on the algorithm: in `sacwb`, the action of
        greater min Q out of the controller's and one drawn from the actor; in `dagger`, the actor's mean action; in `sac`, one
        drawn from the actor.

        Args:
            states: The states.
            share: lambda, 0..1.
        """
        settings = self.settings
        coins, bases = [], []
        for state in states:
            # Drawn in any case, so that the random stream does not depend on the outcome.
            coins.append(float(torch.rand((), generator=self.generator)))
            noise = settings.base_noise * torch.randn(SIZE, generator=self.generator)
            bases.append(np.clip(state.base + noise.numpy(), -1.0, 1.0).astype(np.float32))
        out = [Choice(base, by_actor=False) for base in bases]
        asked = [k for k, coin in enumerate(coins) if not (settings.has_controller and coin < share)]
        if not asked:
            return out
        seen = [states[k] for k in asked]
        distribution = self._distribution(seen)
        action = distribution.mode if settings.algo == "dagger" else distribution.sample(self.generator)[0]
        better = np.ones(len(asked), bool)
        if settings.algo == "sacwb":
            privileged, base = (self._stack(seen, name) for name in ("privileged", "base"))
            values = self.critics.least(torch.cat([privileged, privileged]), torch.cat([base, action])).cpu().numpy()
            better = values[: len(asked)] <= values[len(asked) :]
        for k, mine, own in zip(asked, action.cpu().numpy(), better, strict=True):
            if own:
                out[k] = Choice(mine, by_actor=True)
        return out

    @torch.no_grad()
    def value(self, state: TrainingState) -> float:
        """Return min Q of the actor's mean action: the return that the critics expect from this state."""
        return float(self.critics.least(self._stack([state], "privileged"), self._distribution([state]).mode))

    def update(self, batch: Batch, share: float) -> dict[str, float]:
        """Take one gradient step of everything that the algorithm learns.

        Args:
            batch: Transitions; the actor learns from the first `actor_batch` of them.
            share: lambda, 0..1.

        Returns:
            Figures of this step, by name.
        """
        batch = batch.to(self.device)
        out: dict[str, float] = {}
        if self.settings.has_critics:
            out |= self._update_critics(batch)
        out |= self._update_actor(batch, share)
        self.updates += 1
        if self.settings.has_critics:
            _follow(self.target_critics, self.critics, self.settings.tau)
        # At first the average is the plain mean of all weights so far, so that the random start does not linger in it.
        _follow(self.averaged, self.actor, max(self.settings.averaging, 1.0 / self.updates))
        return out

    def targets(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return the critic targets of a batch, [B], and figures about them, by name."""
        settings, alpha = self.settings, self.alpha
        with torch.no_grad():
            distribution, _ = self._forward(picture(batch.next_image), batch.next_proprio)
            action, log_prob = distribution.sample(self.generator)
            q_actor = self.target_critics.least(batch.next_privileged, action)
            out: dict[str, float] = {}
            if settings.maximum == "none":
                target = losses.plain_target(batch.reward, batch.terminated, q_actor, log_prob, alpha, settings.gamma)
            else:
                q_base = self.target_critics.least(batch.next_privileged, batch.next_base)
                given = (batch.reward, batch.terminated, q_actor, q_base, log_prob)
                log_prob_base = distribution.log_prob(batch.next_base)
                out["surprise_max"] = float(-log_prob_base.min())
                if settings.maximum == "official":
                    target = losses.official_target(*given, alpha, settings.gamma)
                else:
                    target = losses.paper_target(*given, log_prob_base, alpha, settings.gamma)
        out |= {"target_mean": float(target.mean()), "target_max": float(target.max())}
        out["alarm"] = float(self.alarm.see(target))
        return target, out

    def _update_critics(self, batch: Batch) -> dict[str, float]:
        target, out = self.targets(batch)
        first, second = self.critics(batch.privileged, batch.action)
        loss = losses.critic_loss(first, second, target)
        _step(self.optimisers["critics"], loss)
        return {**out, "critic_loss": float(loss.detach())}

    def _update_actor(self, batch: Batch, share: float) -> dict[str, float]:
        settings = self.settings
        rows = slice(settings.actor_batch)
        pictures, proprio = picture(batch.image[rows]), batch.proprio[rows]
        if self.augmenter is not None:
            pictures = self.augmenter(pictures, self.generator)
            proprio = self.augmenter.feel(proprio, self.generator)
        distribution, guess = self._forward(pictures, proprio)
        assert guess is not None
        base, privileged = batch.base[rows], batch.privileged[rows]
        located = losses.position_loss(guess, batch.position[rows])
        loss = settings.position_weight * located
        out = {"position_loss": float(located.detach())}
        mask = torch.ones(len(base), device=self.device)
        if settings.has_critics:
            action, log_prob = distribution.sample(self.generator)
            q_actor = self.critics.least(privileged, action)
            weight = settings.q_weight if settings.has_controller else 1.0
            loss = loss + weight * losses.soft_loss(q_actor, log_prob, self.alpha)
            if settings.has_controller:
                q_base = self.critics.least(privileged, base).detach()
                coin = torch.rand(len(base), generator=self.generator).to(self.device)
                mask = losses.imitated(q_base, q_actor.detach(), coin, share)
                out["advantage"] = float((q_base - q_actor.detach()).mean())
            out["entropy"] = float(-log_prob.detach().mean())
        if settings.has_controller:
            imitation = losses.imitation_loss(distribution.mode, base, mask)
            loss = loss + settings.bc_weight * imitation
            out |= {"imitation_loss": float(imitation.detach()), "imitated_share": float(mask.mean())}
        _step(self.optimisers["actor"], loss)
        if settings.has_critics and settings.alpha_rate > 0:
            _step(self.optimisers["alpha"], losses.temperature_loss(self.log_alpha, log_prob, settings.target_entropy))
            with torch.no_grad():
                self.log_alpha.clamp_(max=math.log(settings.alpha_cap))
        return out

    def state(self) -> dict[str, Any]:
        """Return all that is needed to resume learning, as tensors and plain values."""
        return {
            "actor": self.actor.state_dict(),
            "critics": self.critics.state_dict(),
            "target_critics": self.target_critics.state_dict(),
            "averaged": self.averaged.state_dict(),
            "log_alpha": self.log_alpha.detach().clone(),
            "optimisers": {name: optimiser.state_dict() for name, optimiser in self.optimisers.items()},
            "generator": self.generator.get_state(),
            "updates": self.updates,
            "alarms": self.alarm.count,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned.

        Raises:
            InputError: It belongs to other networks.
        """
        try:
            self.actor.load_state_dict(state["actor"])
            self.critics.load_state_dict(state["critics"])
            self.target_critics.load_state_dict(state["target_critics"])
            self.averaged.load_state_dict(state["averaged"])
            for name, optimiser in self.optimisers.items():
                optimiser.load_state_dict(state["optimisers"][name])
            with torch.no_grad():
                self.log_alpha.copy_(state["log_alpha"])
            self.generator.set_state(state["generator"])
            self.updates, self.alarm.count = int(state["updates"]), int(state["alarms"])
        except (KeyError, RuntimeError, TypeError, ValueError) as error:
            raise InputError("agent", f"the stored state does not fit ({error})", "Delete it and train anew") from error

    def _forward(self, pictures: Tensor, proprio: Tensor) -> tuple[TanhGaussian, Tensor | None]:
        """Run the actor for learning, in bfloat16 if the settings ask for it."""
        kind = torch.device(self.device).type
        with torch.autocast(kind, dtype=torch.bfloat16, enabled=self.settings.bf16):
            return self.actor(pictures, proprio)

    def _distribution(self, states: Sequence[TrainingState]) -> TanhGaussian:
        """Run the actor on some states in full precision."""
        return self.actor(picture(self._stack(states, "image")), self._stack(states, "proprio"))[0]

    def _stack(self, states: Sequence[TrainingState], name: str) -> Tensor:
        """Stack one field of some states, on the networks' device. [B, ...]."""
        return torch.from_numpy(np.stack([getattr(state, name) for state in states])).to(self.device)


@torch.no_grad()
def _follow(slow: torch.nn.Module, fast: torch.nn.Module, share: float) -> None:
    """Move the weights of `slow` towards those of `fast` by a share of their difference."""
    for behind, ahead in zip(slow.parameters(), fast.parameters(), strict=True):
        behind.lerp_(ahead, share)


def _step(optimiser: torch.optim.Optimizer, loss: Tensor) -> None:
    """Take one gradient step with one optimiser; only its own parameters get gradients of the loss."""
    parameters = [parameter for group in optimiser.param_groups for parameter in group["params"]]
    for parameter, gradient in zip(parameters, torch.autograd.grad(loss, parameters, allow_unused=True), strict=True):
        parameter.grad = gradient
    optimiser.step()
