"""Something in an arm's way: it acts in a few moments of a record, at a height that must be found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.gap.joints.looks import Look
from gsbridge.geometry import Array

_LEANS = 3.0
"""Change, in units of the noise, of a moment in which an arm leans on a surface."""

_MOSTLY = 0.5
"""Largest share of what is left in such moments that a surface may leave."""

_NEAR = 2e-3
"""Distance of two heights between which no further one is looked at, m."""


def is_surface(who: Candidate) -> bool:
    """Whether a candidate is something in the arm's way, at a height to find."""
    return bool(who.effect.threshold and not who.effect.blends)


def heights_between(looks: Sequence[Look], row: Array) -> list[dict[str, float]]:
    """Parameters of a surface halfway from the best height that was looked at to those next to it.

    Where every height that the arm reaches does harm, the highest that it does not reach is best: what fits may lie between.

    Args:
        looks: What a surface changes at several heights.
        row: What it might explain. [sum of T C].
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
    # Nothing is reached between two heights that are not.
    near = [
        look
        for look in (lower, higher)
        if abs(look.values["height"] - height) > _NEAR and (look.change.any() or top.change.any())
    ]
    return [{**top.values, "height": 0.5 * (look.values["height"] + height)} for look in near]


def supports(left: Sequence[Array], changes: Sequence[Array], least: float) -> bool:
    """Whether a surface explains most of what is left where an arm leans on it.

    Other effects are judged by whole records; an arm leans on something in a few moments, in which nearly all is its doing.

    Args:
        left: What is left of each record without it, in units of the noise. Each [T, C].
        changes: What it changes. Each [T, C].
        least: Least reduction of the length of all residuals together.
    """
    before, after = list(left), [row - change for row, change in zip(left, changes, strict=True)]
    touched = [(change**2).sum(axis=1) > _LEANS**2 for change in changes]
    there = [
        sum(float((rows[moments] ** 2).sum()) for rows, moments in zip(kind, touched, strict=True)) for kind in (before, after)
    ]
    lengths = [float(np.sqrt(sum((rows**2).sum() for rows in kind))) for kind in (before, after)]
    return there[1] < _MOSTLY * there[0] and lengths[0] - lengths[1] >= least
