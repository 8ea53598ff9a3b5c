"""White noise on logged series: its size from differences, which motion leaves alone, pooled over records of one sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import comb

from gsbridge.geometry import Array

_ORDER = 4
"""Order of the difference whose spread tells the noise: motion is gone from it, white noise is not."""

_CUT = 3.0
"""Spreads beyond which a difference is a jump (friction at a reversal, a lost sample), not noise."""

_KEPT_SHARE = 0.9733
"""Variance of a normal variable within `_CUT` spreads."""

_ALIKE = 1.3
"""Ratio up to which estimates of several records are taken for one noise."""


def white_noise(values: Array) -> Array:
    """Spread of the white noise on smooth series, robust against jumps. [T, N] -> [N]."""
    high = np.diff(values, _ORDER, axis=0)
    high = high - np.median(high, axis=0)
    rough = 1.4826 * np.median(np.abs(high), axis=0)
    inside = np.abs(high) <= _CUT * rough
    spread = np.sqrt((high**2 * inside).sum(axis=0) / np.maximum(inside.sum(axis=0), 1) / _KEPT_SHARE)
    return spread / np.sqrt(sum(comb(_ORDER, k) ** 2 for k in range(_ORDER + 1)))


def pooled(estimates: Sequence[Array]) -> list[Array]:
    """Noise per record and channel: one estimate where the records agree, each record's own where they do not. [C] each."""
    table = np.stack(estimates)
    same = table.max(axis=0) < _ALIKE * table.min(axis=0)
    return [np.where(same, np.sqrt((table**2).mean(axis=0)), row) for row in table]
