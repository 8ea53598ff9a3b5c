"""The networks: an actor that sees pictures, and critics that see the privileged vector.

Sources: soft actor-critic, Haarnoja et al. 2018; spatial soft-argmax, Levine et al., "End-to-end training of deep visuomotor
policies", 2016; critics that see more than the actor, Pinto et al., "Asymmetric actor critic", 2018.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from gsbridge.environment.env import PROPRIO
from gsbridge.policy.observation import POSITION, PRIVILEGED
from gsbridge.sim.actions import SIZE

LOG_STD = (-5.0, 2.0)
"""Range of the logarithm of an action's standard deviation before tanh."""

EDGE = 1e-3
"""Actions are cut to +-(1 - EDGE) before tanh^-1, which is infinite at 1, since controllers give actions of 1."""

CHANNELS = (16, 32, 32)
HIDDEN = 256
_HEAD = 64


class SoftArgmax(nn.Module):
    """Position at which each channel is large, and its value there."""

    def forward(self, features: Tensor) -> Tensor:
        """Return the expected place and value of each channel.

        Args:
            features: Feature maps of the pictures. [B, C, H, W].

        Returns:
            Columns, rows, -1..1, and values. float32 [B, 3 C].
        """
        count, channels, height, width = features.shape
        flat = features.float().flatten(2)
        share = torch.softmax(flat, dim=2)
        columns = torch.linspace(-1.0, 1.0, width, device=flat.device).repeat(height)
        rows = torch.linspace(-1.0, 1.0, height, device=flat.device).repeat_interleave(width)
        places = share @ torch.stack([columns, rows], dim=1)
        return torch.cat([places.reshape(count, 2 * channels), (share * flat).sum(2)], dim=1)


class Encoder(nn.Module):
    """Three convolutions and a soft-argmax, which give the places of features instead of feature maps."""

    def __init__(self) -> None:
        super().__init__()
        first, second, third = CHANNELS
        self.layers = nn.Sequential(
            nn.Conv2d(3, first, 5, 2),
            nn.ReLU(),
            nn.Conv2d(first, second, 3, 2),
            nn.ReLU(),
            nn.Conv2d(second, third, 3, 1),
            nn.ReLU(),
            SoftArgmax(),
        ).to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it
        self.size = 3 * third

    def forward(self, pictures: Tensor) -> Tensor:
        """Features. [B, 3, H, W] -> [B, 96]."""
        return self.layers(pictures)


@dataclass(frozen=True)
class TanhGaussian:
    """Actions tanh(mean + std * e), e normally distributed.

    Args:
        mean: Mean before tanh. [B, 5].
        log_std: Logarithm of the standard deviation before tanh. [B, 5].
    """

    mean: Tensor
    log_std: Tensor

    @property
    def mode(self) -> Tensor:
        """Action tanh(mean). [B, 5]."""
        return torch.tanh(self.mean)

    def sample(self, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Draw actions through which gradients flow, and return them with their log probability.

        Args:
            generator: CPU generator.

        Returns:
            [B, 5] and [B].
        """
        noise = torch.randn(self.mean.shape, generator=generator).to(self.mean.device)
        before = self.mean + self.log_std.exp() * noise
        return torch.tanh(before), self._log_prob(before)

    def log_prob(self, action: Tensor) -> Tensor:
        """Return the log probability density of given actions, first cut to +-(1 - EDGE). [B, 5] -> [B]."""
        return self._log_prob(torch.atanh(action.clamp(-1.0 + EDGE, 1.0 - EDGE)))

    def _log_prob(self, before: Tensor) -> Tensor:
        """log pi of tanh(before): the normal density less log(1 - tanh^2), written so that it stays finite for large values."""
        normal = -0.5 * ((before - self.mean) * (-self.log_std).exp()) ** 2 - self.log_std - 0.5 * math.log(2.0 * math.pi)
        slope = 2.0 * (math.log(2.0) - before - nn.functional.softplus(-2.0 * before))
        return (normal - slope).sum(-1)


class Actor(nn.Module):
    """Maps a picture and proprioception to a distribution of actions and an estimate of the object's position.

    Args:
        with_position: Whether the network has the auxiliary head, which a deployed policy does not need.
    """

    def __init__(self, *, with_position: bool = True) -> None:
        super().__init__()
        self.encoder = Encoder()
        inputs = self.encoder.size + PROPRIO
        self.body = nn.Sequential(nn.Linear(inputs, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU())
        self.mean, self.log_std = nn.Linear(HIDDEN, SIZE), nn.Linear(HIDDEN, SIZE)
        self.position = (
            nn.Sequential(nn.Linear(inputs, _HEAD), nn.ReLU(), nn.Linear(_HEAD, POSITION)) if with_position else None
        )

    def forward(self, pictures: Tensor, proprio: Tensor) -> tuple[TanhGaussian, Tensor | None]:
        """Return the distribution of actions and the estimated position of the object.

        Args:
            pictures: -0.5..0.5, [B, 3, H, W].
            proprio: Proprioception. [B, 12].

        Returns:
            The distribution, float32 [B, 5]; the estimate of the position label, [B, 3], or None without the head.
        """
        features = torch.cat([self.encoder(pictures), proprio], dim=1)
        hidden = self.body(features)
        low, high = LOG_STD
        log_std = low + 0.5 * (high - low) * (torch.tanh(self.log_std(hidden).float()) + 1.0)
        position = None if self.position is None else self.position(features).float()
        return TanhGaussian(self.mean(hidden).float(), log_std), position


class Critics(nn.Module):
    """Two critics, which estimate the action value from the privileged vector.

    Args:
        bounded: Whether a sigmoid bounds the values to 0..1.
    """

    def __init__(self, *, bounded: bool = False) -> None:
        super().__init__()
        self.bounded = bounded
        self.first, self.second = (
            nn.Sequential(
                nn.Linear(PRIVILEGED + SIZE, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, 1)
            )
            for _ in range(2)
        )

    def forward(self, privileged: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """Return both values. [B, 30], [B, 5] -> [B], [B]."""
        both = torch.cat([privileged, action], dim=1)
        values = self.first(both)[:, 0], self.second(both)[:, 0]
        return (torch.sigmoid(values[0]), torch.sigmoid(values[1])) if self.bounded else values

    def least(self, privileged: Tensor, action: Tensor) -> Tensor:
        """Return the smaller of both values. [B, 30], [B, 5] -> [B]."""
        return torch.minimum(*self(privileged, action))
