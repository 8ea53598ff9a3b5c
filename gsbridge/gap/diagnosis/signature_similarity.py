"""Effects that look alike before any fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gsbridge.geometry import Array

ALIKE = 0.95
"""Cosine of two signatures from which on a fit can hardly tell their effects apart."""


def similar_pairs(names: Sequence[str], cosines: Array) -> list[dict[str, Any]]:
    """Pairs of effects that look alike, the closest first, as in `screen.json`.

    Args:
        names: Of the effects. [N].
        cosines: Of their signatures, or the largest where they have several. [N, N].
    """
    pairs = [
        {"pair": [names[a], names[b]], "cosine": float(cosines[a, b])}
        for a in range(len(names))
        for b in range(a)
        if cosines[a, b] >= ALIKE
    ]
    return sorted(pairs, key=lambda item: -item["cosine"])
