"""Confidence intervals of counted success rates: of one policy, or of several trainings with trials each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from gsbridge.geometry import Array

CONFIDENCE = 0.95

REDRAWS = 4000
"""Number of bootstrap samples; with so many, the limits of an interval scatter by less than half a percentage point."""

Tally = tuple[int, int]
"""Successes and trials of one training."""


def wilson_interval(successes: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Wilson's score interval of a success rate, without correction for continuity.

    Args:
        successes: 0 to `trials`.
        trials: Number of all trials, at least 1.
        confidence: Two-sided confidence level, between 0 and 1.

    Returns:
        Lower and upper limit, 0..1.

    Raises:
        ValueError: The counts or the confidence make no sense.

    Source: Wilson, Probable inference, the law of succession, and statistical inference, 1927.
    """
    check_counts(successes, trials)
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"a confidence of {confidence} is not between 0 and 1")
    interval = stats.binomtest(successes, trials).proportion_ci(confidence, method="wilson")
    return float(interval.low), float(interval.high)


def redrawn_rates(tallies: Sequence[Tally], seed: int = 0) -> Array:
    """Success rates of a hierarchical bootstrap, which resamples trainings and then the trials of each. [REDRAWS].

    All trials of a training count alike, so that resampling them is a binomial draw of the number of successes.

    Args:
        tallies: Successes and trials of each training. [T].
        seed: Seed of the draws.

    Raises:
        ValueError: There is no training, or counts make no sense.

    Source: Davison and Hinkley, Bootstrap Methods and their Application, 1997, section 3.8.
    """
    if not tallies:
        raise ValueError("no training was tried")
    for tally in tallies:
        check_counts(*tally)
    good, tried = np.array(tallies, dtype=np.int64).T
    rng = np.random.default_rng([seed, len(tallies)])
    chosen = rng.integers(len(tallies), size=(REDRAWS, len(tallies)))
    redrawn = rng.binomial(tried[chosen], (good / tried)[chosen])
    return np.asarray(redrawn.sum(1) / tried[chosen].sum(1))


def trainings_interval(tallies: Sequence[Tally]) -> tuple[float, float]:
    """95 % interval of the success rate of a way of learning.

    For one training it is Wilson's interval, which says nothing about other trainings. For several, each limit is the outer one
    of two: the hierarchical bootstrap's, and Wilson's for all trials together. Where all trials ended alike, the bootstrap has
    no spread.

    Args:
        tallies: Successes and trials of each training. [T].

    Returns:
        Lower and upper limit, 0..1.

    Raises:
        ValueError: As `redrawn_rates`.
    """
    low, high = wilson_interval(sum(good for good, _ in tallies), sum(tried for _, tried in tallies))
    if len(tallies) == 1:
        return low, high
    drawn = limits(redrawn_rates(tallies))
    return min(low, drawn[0]), max(high, drawn[1])


def limits(draws: Array) -> tuple[float, float]:
    """Lower and upper limit of the central 95 % of draws, [N]."""
    low, high = np.quantile(draws, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def check_counts(successes: int, trials: int) -> None:
    """Refuse impossible counts.

    Raises:
        ValueError: There is no trial, or there are more successes than trials.
    """
    if not (trials >= 1 and 0 <= successes <= trials):
        raise ValueError(f"{successes} successes of {trials} trials cannot be")
