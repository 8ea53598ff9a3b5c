"""The interval of a rate that was counted: of one policy, or of several trainings with trials each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from gsbridge.geometry import Array

CONFIDENCE = 0.95

REDRAWS = 4000
"""Redraws of a bootstrap: its limits scatter by less than half a point."""

Tally = tuple[int, int]
"""Successes and trials of one training."""


def wilson_interval(successes: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Wilson's score interval of a success rate, without correction for continuity.

    Args:
        successes: 0 to `trials`.
        trials: All trials, at least 1.
        confidence: Two-sided, between 0 and 1.

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
    """Success rates of a hierarchical bootstrap: trainings are drawn anew, then the starts of each. [REDRAWS].

    Of starts that count alike only how many succeed matters, so that drawing them anew is a binomial draw.

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

    Of one training it is Wilson's: it says nothing of other trainings. Of several it is that of a hierarchical bootstrap, and
    Wilson's of all trials where that is wider: where every trial went alike nothing is left to redraw.

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
    """Limits between which 95 % of draws lie. [N]."""
    low, high = np.quantile(draws, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def check_counts(successes: int, trials: int) -> None:
    """Refuse counts that cannot be.

    Raises:
        ValueError: There is no trial, or there are more successes than trials.
    """
    if not (trials >= 1 and 0 <= successes <= trials):
        raise ValueError(f"{successes} successes of {trials} trials cannot be")
