"""Settings of the trainings of policies."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from gsbridge.configuration.base import Device, Given, Number, PictureSize, Settings, Share, Switch, Whole, fault


class PolicySettings(Settings):
    """How a policy learns. The defaults are the standard cell on one CPU thread."""

    algo: Literal["sacwb", "sac", "bc", "dagger"] = "sacwb"
    """`sacwb` (SAC with baseline controller, the paper's), `sac` (no controller), `bc` (imitates the controller on its own
    episodes) or `dagger` (imitates it on the policy's episodes, too)."""
    target: Literal["official", "paper", "none"] = "official"
    """Critic target of `sacwb`: `official` (maximum of both branches, one entropy term), `paper` (the paper's equation;
    diverges for large alpha) or `none` (no maximum); see `gsbridge.policy.losses`."""
    image_size: PictureSize = 64
    """Edge of the square picture that the policy sees, px; the environment draws it in this size."""
    steps: Whole = Field(default=9000, ge=1, le=10_000_000)
    """Environment steps of the whole training."""
    start_steps: Whole = Field(default=300, ge=1, le=1_000_000)
    """Steps before the first update; `sac` acts at random in them, the others follow the controller."""
    updates_per_step: Number = Field(default=0.4, ge=0.01, le=8)
    """Gradient steps per environment step."""
    actor_batch: Whole = Field(default=128, ge=2, le=4096)
    """Transitions per gradient step of the actor, which takes the first of the critics'."""
    critic_batch: Whole = Field(default=128, ge=2, le=4096)
    """Transitions per gradient step of the critics, at least the actor's."""
    learning_rate: Number = Field(default=1e-3, ge=1e-6, le=0.1)
    """Step size of Adam, actor and critics."""
    tau: Number = Field(default=0.01, ge=1e-4, le=1)
    """Share of the critics that enters the target critics per update."""
    # At a learning rate that learns within minutes, success swings widely from one evaluation to the next.
    averaging: Number = Field(default=0.005, ge=1e-4, le=1)
    """Share of the actor that enters the averaged actor per update; the average is what is evaluated and delivered, 1 takes the
    actor as it is."""
    gamma: Number = Field(default=0.97, ge=0.5, le=0.9999)
    """Discount per step."""
    # From about 0.01 the entropy of an endless episode, alpha |H| / (1 - gamma), outweighs the reward of 1.
    alpha_start: Number = Field(default=0.001, ge=1e-6, le=1)
    """Temperature at the start, at most its upper limit."""
    alpha_cap: Number = Field(default=0.01, ge=1e-6, le=1)
    """Upper limit of the temperature."""
    alpha_rate: Number = Field(default=1e-3, ge=0, le=0.1)
    """Step size of log alpha; 0 keeps it."""
    target_entropy: Number = Field(default=-5.0, ge=-50, le=5)
    """Entropy that the temperature aims at, nats."""
    # At a floor of 0, as in the paper, nothing imitates where young critics err.
    lambda_floor: Share = 0.1
    """Least share of the controller, which falls from 1 straight down to it."""
    lambda_share: Number = Field(default=0.5, ge=0.01, le=1)
    """Share of `steps` over which the controller's share falls."""
    position_weight: Number = Field(default=1.0, ge=0, le=100)
    """Weight of the auxiliary loss on the object's position."""
    bc_weight: Number = Field(default=1.0, ge=0, le=100)
    """Weight of imitation in the actor's loss."""
    q_weight: Number = Field(default=0.1, ge=0, le=100)
    """Weight of the SAC loss in the actor's loss."""
    base_noise: Share = 0.1
    """Standard deviation of noise on the controller's actions when they are carried out, never on labels."""
    augment: Switch = True
    """Vary the colours of the pictures that the actor learns from, and add noise."""
    jitter: Number = Field(default=1.0, ge=0, le=2.3)
    """Factor on how widely they are varied."""
    litter: Whole = Field(default=6, ge=0, le=20)
    """Largest number of flat things that lie about in the pictures of an episode of the training, its evaluations included."""
    latency: Number = Field(default=0.12, ge=0, le=0.3)
    """Longest dead time of commands beyond the model's, s; each episode of the training draws its own, its evaluations
    included."""
    bounded_critic: Switch = False
    """Squash Q to 0..1 by a sigmoid, as RL-GSBridge's code does."""
    bf16: Switch = False
    """Compute the actor's gradients in bfloat16: twice as fast on processors with instructions for it, ten times slower on
    others."""
    replay_capacity: Whole = Field(default=12_000, ge=200, le=10_000_000)
    """Frames that the replay buffer holds."""
    eval_every: Whole = Field(default=1000, ge=1, le=1_000_000)
    """Steps between two evaluations."""
    eval_poses: Whole = Field(default=32, ge=4, le=1024, multiple_of=4)
    """Start poses of an evaluation, as many in each quadrant."""
    stop_after: Whole = Field(default=2, ge=0, le=1000)
    """Number of evaluations in a row without a failure after which training stops; 0 never stops early."""
    environments: Whole = Field(default=1, ge=1, le=256)
    """Environments in which training episodes run at the same time, each in a process of its own, so that the actor sees a
    batch of pictures. With several, an evaluation ends the episodes that are running."""
    device: Device = "cpu"
    """Device that the networks run on."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if isinstance(self, Given):  # what it overrides is not known yet
            return self
        if self.critic_batch < self.actor_batch:
            raise fault(f"critic_batch is {self.critic_batch}", f"Give at least the actor's {self.actor_batch}")
        if self.alpha_start > self.alpha_cap:
            raise fault(f"alpha_start is {self.alpha_start:g}", f"Give at most alpha_cap, {self.alpha_cap:g}")
        return self

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


class PolicyOverride(Given, PolicySettings):
    """Settings of a training that go before its task's."""
