"""White noise on logged series: its size from differences, which motion leaves alone, pooled over records of one sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import comb
from scipy.stats import f as f_ratio

from gsbridge.geometry import Array

_ORDER = 4
"""Order of the difference whose spread tells the noise: motion is gone from it, white noise is not."""

_CUT = 3.0
"""Spreads beyond which a difference is a jump (friction at a reversal, a lost sample), not noise."""

_KEPT_SHARE = 0.9733
"""Variance of a normal variable within `_CUT` spreads."""

_ALIKE = 1.3
"""Ratio up to which estimates of several records are taken for one noise, however long they are."""

_PER_FREEDOM = 2.9
"""Samples of a record for each independent square in an estimate: differences of neighbouring samples share their noise (2.6
in theory), and some are cut off."""

_RARE = 1e-6
"""Probability that two estimates of one noise differ so much that they are taken for two: a case compares dozens of channels,
each on three records."""


def white_noise(values: Array) -> Array:
    """Spread of the white noise on smooth series, robust against jumps. [T, N] -> [N]."""
    high = np.diff(values, _ORDER, axis=0)
    high = high - np.median(high, axis=0)
    rough = 1.4826 * np.median(np.abs(high), axis=0)
    inside = np.abs(high) <= _CUT * rough
    spread = np.sqrt((high**2 * inside).sum(axis=0) / np.maximum(inside.sum(axis=0), 1) / _KEPT_SHARE)
    return spread / np.sqrt(sum(comb(_ORDER, k) ** 2 for k in range(_ORDER + 1)))


def pooled(estimates: Sequence[Array], counts: Sequence[int]) -> list[Array]:
    """Noise per record and channel: one estimate where the records agree, each record's own where they do not.

    Args:
        estimates: Noise of each channel as each record tells it. [C] each.
        counts: Samples of each record.

    Returns:
        [C] each.
    """
    table = np.stack(estimates)
    # A short record's estimate differs from another's by chance: its own would then make noise of a motion, or motion of noise.
    freedom = max(min(counts) / _PER_FREEDOM, 1.0)
    alike = max(_ALIKE, float(np.sqrt(f_ratio.isf(_RARE, freedom, freedom))))
    same = table.max(axis=0) < alike * table.min(axis=0)
    return [np.where(same, np.sqrt((table**2).mean(axis=0)), row) for row in table]
