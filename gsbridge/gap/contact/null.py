"""How far replay and measurement would be apart if nothing were missing: starts are known with noise, engines choose for
themselves how hard a contact is pushed apart and how long a step is, and chaos enlarges both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsbridge.effects.registry import Applied
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.world import Numerics
from gsbridge.geometry import Array

REPLICATES = 6
"""Sets of throws that are simulated."""

FEW = 40
"""Throws in each: more say little more about one throw."""

_DRAWS = 499

_STEPS = (0.7, 2.0)
"""Factors of the step."""

_PUSHES = (0.05, 0.3)
"""Shares of a penetration that a step takes back."""


@dataclass(frozen=True)
class ThrowNull:
    """Errors of effect-free replicates.

    Args:
        errors: Mean distance of each throw, m. [K, M].
        draws: Statistics of sets drawn from them. [D, 2].
    """

    errors: Array
    draws: Array

    @property
    def floor(self) -> float:
        """Mean distance that noise, chaos and the engine's choices explain, m."""
        return float(self.errors.mean())

    def p_value(self, errors: Array) -> float:
        """Share of effect-free sets at least as far apart, by the mean or by the mean logarithm. [N]."""
        middle = np.median(self.draws, axis=0)
        spread = np.maximum(np.quantile(self.draws, 0.975, axis=0) - middle, 1e-9)
        sizes = ((self.draws - middle) / spread).max(axis=1)
        seen = ((_statistics(errors[None])[0] - middle) / spread).max()
        return float((1 + (sizes >= seen).sum()) / (1 + len(sizes)))


def _statistics(errors: Array) -> Array:
    """Mean and mean logarithm of sets: one sees what is large, the other a small change of every throw. [D, N] -> [D, 2]."""
    return np.stack([errors.mean(axis=1), np.log(np.maximum(errors, 1e-9)).mean(axis=1)], axis=1)


def replicates(
    replay: ThrowReplay, effects: Sequence[Applied], rng: np.random.Generator, count: int = REPLICATES
) -> list[list[Array]]:
    """Differences between sets of throws of a model with these effects as truth, measured with noise, and their replay.

    Args:
        replay: Throws and model.
        effects: Effects of the truth and of the replay.
        rng: Random numbers for noise, first states and the engine's choices.
        count: Sets.

    Returns:
        Log's frame, m, for each set and throw. Each [T, 3].
    """
    plain, noise = replay.flights(effects), replay.noise
    out = []
    for _ in range(count):
        step, push = (float(np.exp(rng.uniform(np.log(low), np.log(high)))) for low, high in (_STEPS, _PUSHES))
        truth = replay.simulate(effects, replay.starts.shifted(noise, rng), Numerics(step, push))
        seen = [flight.position + rng.normal(0.0, noise.position, flight.position.shape) for flight in truth]
        out.append([at - flight.position for at, flight in zip(seen, plain, strict=True)])
    return out


def throw_null(replay: ThrowReplay, effects: Sequence[Applied], rng: np.random.Generator) -> ThrowNull:
    """Errors of the first throws as they would be if these effects were the truth and the same model replayed it.

    Args:
        replay: Throws and model.
        effects: Effects of truth and replay.
        rng: Random numbers of noise, first states, the engine's choices and the draws of sets.
    """
    rows = replicates(replay.part(FEW), effects, rng)
    errors = np.array([[np.linalg.norm(difference, axis=1).mean() for difference in row] for row in rows])
    # One engine makes all throws of a set, so that sets are drawn from one replicate each.
    which = rng.integers(0, len(errors), _DRAWS)
    throws = rng.integers(0, errors.shape[1], (_DRAWS, len(replay)))
    return ThrowNull(errors, _statistics(errors[which[:, None], throws]))
