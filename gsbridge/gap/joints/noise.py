"""Estimate white noise on logged series from their differences, which hardly contain motion, and pool it over records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import comb
from scipy.stats import f as f_ratio

from gsbridge.geometry import Array

_ORDER = 4
"""Order of the difference from which the noise is estimated: it removes the motion, but not white noise."""

_CUT = 3.0
"""Standard deviations beyond which a difference is a jump (friction at a reversal, a lost sample), not noise."""

_KEPT_SHARE = 0.9733
"""Variance of a standard normal variable that is cut off at `_CUT` standard deviations."""

_ALIKE = 1.3
"""Ratio up to which the estimates of several records always count as the same noise, however long the records are."""

_PER_FREEDOM = 2.9
"""Samples per degree of freedom of an estimate: neighbouring differences are correlated (2.6 in theory), and some are cut
off."""

_RARE = 1e-6
"""Probability that two estimates of the same noise are taken for different ones. It is small, since a case compares dozens of
channels, each on three records."""


def white_noise(values: Array, order: int = _ORDER) -> Array:
    """Estimate the standard deviation of white noise on smooth series, robust against jumps.

    Args:
        values: The series. [T, N].
        order: Order of the difference; the more, the faster may the motion between two samples be.

    Returns:
        Standard deviation of each series. [N].
    """
    high = np.diff(values, order, axis=0)
    high = high - np.median(high, axis=0)
    rough = 1.4826 * np.median(np.abs(high), axis=0)
    inside = np.abs(high) <= _CUT * rough
    spread = np.sqrt((high**2 * inside).sum(axis=0) / np.maximum(inside.sum(axis=0), 1) / _KEPT_SHARE)
    return spread / np.sqrt(sum(comb(order, k) ** 2 for k in range(order + 1)))


def pooled(estimates: Sequence[Array], counts: Sequence[int]) -> list[Array]:
    """Pool noise estimates over records, channel by channel; where records disagree, each keeps its own.

    Args:
        estimates: Noise of each channel as estimated on each record. [C] each.
        counts: Number of samples of each record.

    Returns:
        Noise of each channel for each record. [C] each.
    """
    table = np.stack(estimates)
    # Estimates from short records differ by chance. Kept apart, they would turn motion into noise, or noise into motion.
    freedom = max(min(counts) / _PER_FREEDOM, 1.0)
    alike = max(_ALIKE, float(np.sqrt(f_ratio.isf(_RARE, freedom, freedom))))
    same = table.max(axis=0) < alike * table.min(axis=0)
    return [np.where(same, np.sqrt((table**2).mean(axis=0)), row) for row in table]
