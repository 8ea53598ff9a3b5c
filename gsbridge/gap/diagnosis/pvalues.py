"""p-values from replicates, also where fewer than one of them is as large."""

from __future__ import annotations

import numpy as np

from gsbridge.geometry import Array

_SHARE = 0.1
"""Share of the replicates that tells how the tail falls."""

LEAST = 1e-6
"""p-value below which a tail from so few replicates says nothing."""


def tail_pvalue(replicas: Array, value: float) -> float:
    """Share of replicates at least as large as a value; among the largest tenth by an exponential tail through them.

    Maxima and sums of noise have tails that fall no slower. Without the tail nothing could be less likely than one replicate.

    Args:
        replicas: Drawn without an effect. [R].
        value: The observed value.

    Source: Pickands, Annals of Statistics 3, 1975 (peaks over a threshold), with shape 0.
    """
    edge = float(np.quantile(replicas, 1.0 - _SHARE))
    if value <= edge:
        return float((1 + (replicas >= value).sum()) / (1 + len(replicas)))
    beyond = replicas[replicas > edge] - edge
    return max(_SHARE * float(np.exp(-(value - edge) / max(float(beyond.mean()), 1e-300))), LEAST)
