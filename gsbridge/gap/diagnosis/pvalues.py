"""p-values from replicates, also for values beyond all replicates."""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array

_SHARE = 0.1
"""Share of the replicates, the largest ones, to which the tail is fitted."""

LEAST = 1e-6
"""Smallest p-value that is returned; a tail fitted to so few replicates says nothing about smaller ones."""


def tail_pvalue(replicas: Array, value: float) -> float:
    """Estimate a value's p-value as the share of replicates at least as large; beyond 90 % of them, by an exponential tail.

    The tails of maxima and sums of noise fall at least as fast as an exponential. Without a fitted tail, no p-value could be
    smaller than that of one replicate, 1 / (1 + R).

    Args:
        replicas: Values of the statistic drawn without an effect. [R].
        value: The observed value.

    Source: Pickands, Annals of Statistics 3, 1975 (peaks over a threshold), with shape 0.
    """
    edge = float(np.quantile(replicas, 1.0 - _SHARE))
    if value <= edge:
        return float((1 + (replicas >= value).sum()) / (1 + len(replicas)))
    beyond = replicas[replicas > edge] - edge
    return max(_SHARE * float(np.exp(-(value - edge) / max(float(beyond.mean()), 1e-300))), LEAST)
