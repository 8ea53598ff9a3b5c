"""The interval of a rate that was counted."""

from __future__ import annotations

from scipy import stats

CONFIDENCE = 0.95


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


def check_counts(successes: int, trials: int) -> None:
    """Refuse counts that cannot be.

    Raises:
        ValueError: There is no trial, or there are more successes than trials.
    """
    if not (trials >= 1 and 0 <= successes <= trials):
        raise ValueError(f"{successes} successes of {trials} trials cannot be")
