"""What a candidate effect changes beside an explanation, and which of several promise most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gsbridge.effects.joints.base import HOOKS
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.geometry import Array

_NEARLY, _ALIKE = 0.8, 0.95
"""Shares of an effect's gain that others must reach to be told in its place: a simpler effect on the same joint, and one that
acts nearer to the command."""

_FACTORS = (0.1, 10.0)
"""Range of the guess at a candidate's size, in multiples of the size at which it was simulated."""


@dataclass(frozen=True)
class Look:
    """What a candidate changes beside some explanation.

    Args:
        candidate: The candidate.
        values: Its parameters there.
        change: In all records, in units of the noise. [sum of T C].
    """

    candidate: Candidate
    values: dict[str, float]
    change: Array

    def beside(self, basis: Array) -> Look:
        """Part of the change that no other effect can make: what is left of it beside the directions of the others.

        Args:
            basis: Orthonormal directions in which the residual moves with the parameters of others. [sum of T C, P].
        """
        return replace(self, change=self.change - basis @ (basis.T @ self.change))

    def guess(self, row: Array) -> tuple[float, float]:
        """Factor that fits a residual best, and by how much the candidate then reduces its square. [sum of T C]."""
        along, size = float(self.change @ row), float(self.change @ self.change)
        if size <= 0.0:
            return 1.0, 0.0
        factor = 1.0 if self.candidate.effect.threshold else float(np.clip(along / size, *_FACTORS))
        return factor, 2.0 * factor * along - factor**2 * size

    def scaled(self, factor: float) -> dict[str, float]:
        """Parameters times a factor."""
        out: dict[str, float] = self.candidate.effect.scaled(self.values, factor)
        return out


def key_of(candidate: Candidate, values: dict[str, float]) -> tuple[Candidate, tuple[float, ...]]:
    """What a candidate's change stands for: all of its sizes, or this one alone where it begins at a threshold."""
    return candidate, tuple(values.values()) if candidate.effect.threshold else ()


def plainest_first(found: list[tuple[float, Look]]) -> list[tuple[float, Look]]:
    """Candidates in order of merit, with the best one behind a plainer one that does about as well.

    Plainer is what has fewer parameters on the same joint; or, of effects with as many that act on the same joints, what takes
    hold nearer to the command, so that two that no motion tells apart are always told by the same name.
    """
    if not found:
        return []
    gain, best = found[0]

    def order(look: Look) -> tuple[int, int, str]:
        effect = look.candidate.effect
        return len(effect.parameters), HOOKS.index(effect.hook), effect.name

    plain = [
        item
        for item in found[1:]
        if item[1].candidate.joint == best.candidate.joint
        and (
            (item[0] > _NEARLY * gain and order(item[1])[0] < order(best)[0])
            or (item[0] > _ALIKE * gain and order(item[1]) < order(best))
        )
    ]
    head = min(plain, key=lambda item: order(item[1]), default=found[0])
    return [head, *(item for item in found if item is not head)]
