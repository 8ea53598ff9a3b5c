"""How much of a gap an explanation closes, as far as noise tells."""

from __future__ import annotations

import numpy as np

from gsbridge.gap.detect import block_means
from gsbridge.geometry import Array

_LENGTHS = (1, 16)
"""Samples of the blocks over which a closure is judged."""

_ALLOWED = 0.02
"""Share of a gap's squares that may be left to noise where a closure is judged."""


def closed(before: Array, after: Array, share: float) -> float:
    """Share of a gap that is closed: of the samples themselves and, if the gap is slow, of means over blocks, the lesser one.

    One spread of the noise's squares is allowed, which hides that a large gap is closed; of a small gap it is much. Means have
    less noise, so that they show what is left of a slow motion where the samples hide it.

    Args:
        before: Whitened residual without the explanation. [T, C].
        after: With it. [T, C].
        share: Mean square of noise alone.
    """
    out: list[float] = []
    whole = 0.0
    for scale in _LENGTHS:
        sums = [float((block_means(residual, scale) ** 2).sum()) for residual in (before, after)]
        count = block_means(before, scale).size
        gap = max(sums[0] - share * count, 1e-9)
        whole = max(whole, gap)
        if gap < 0.5 * whole:
            continue
        left = sums[1] - share * count - min(np.sqrt(2.0 * count), _ALLOWED * gap)
        out.append(1.0 - float(np.sqrt(max(left, 0.0) / gap)))
    return min(out)
