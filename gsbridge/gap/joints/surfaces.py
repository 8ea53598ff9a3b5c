"""Surfaces in an arm's way: they act in a few moments of a record, at a height that must be found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.joints.looks import Look
from gsbridge.geometry import Array

_LEANS = 3.0
"""Change of a sample by a surface, in units of the noise, above which the arm leans on it then."""

_MOSTLY = 0.5
"""Share of the squared residual in such moments that a surface may leave."""

_NEAR = 2e-3
"""Distance of two heights up to which no height between them is tried, m."""


def is_surface(who: Candidate) -> bool:
    """Tell whether a candidate is a surface in the arm's way, at a height to find."""
    return bool(who.effect.threshold and not who.effect.blends)


def heights_between(looks: Sequence[Look], row: Array) -> list[dict[str, float]]:
    """Propose surfaces halfway between the best height tried so far and the next one on either side.

    If every height that the arm reaches makes the residual worse, the highest that it does not reach counts as best: the right
    one may lie just above it.

    Args:
        looks: Changes by a surface at several heights.
        row: Residual to explain, in units of the noise. [sum of T C].
    """
    if not looks:
        return []
    top = max(looks, key=lambda look: (look.guess(row)[1], look.values["height"]))
    alike = [look for look in looks if look.values["stiffness"] == top.values["stiffness"]]
    height = top.values["height"]
    lower = max((look for look in alike if look.values["height"] < height), key=lambda look: look.values["height"], default=top)
    higher = min(
        (look for look in alike if look.values["height"] > height), key=lambda look: look.values["height"], default=top
    )
    # If the arm reaches neither of two heights, it reaches none between them.
    near = [
        look
        for look in (lower, higher)
        if abs(look.values["height"] - height) > _NEAR and (look.change.any() or top.change.any())
    ]
    return [{**top.values, "height": 0.5 * (look.values["height"] + height)} for look in near]


def supports(left: Sequence[Array], changes: Sequence[Array], least: float) -> bool:
    """Tell whether a surface explains most of the residual at the moments when an arm leans on it.

    Other effects are judged over whole records. An arm leans on a surface in a few moments only, in which the surface causes
    nearly all of the residual.

    Args:
        left: Residual of each record without the surface, in units of the noise. Each [T, C].
        changes: Change of each residual by the surface, in units of the noise. Each [T, C].
        least: Least reduction of the length of all residuals together, in units of the noise.
    """
    before, after = list(left), [row - change for row, change in zip(left, changes, strict=True)]
    touched = [(change**2).sum(axis=1) > _LEANS**2 for change in changes]
    there = [
        sum(float((rows[moments] ** 2).sum()) for rows, moments in zip(kind, touched, strict=True)) for kind in (before, after)
    ]
    lengths = [float(np.sqrt(sum((rows**2).sum() for rows in kind))) for kind in (before, after)]
    return there[1] < _MOSTLY * there[0] and lengths[0] - lengths[1] >= least
