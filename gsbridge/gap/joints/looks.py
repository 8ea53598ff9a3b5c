"""Looks: the change that a candidate effect makes beside an explanation, and the order in which candidates are fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gsbridge.effects.joints.base import HOOKS
from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.geometry import Array

_NEARLY, _ALIKE = 0.8, 0.95
"""Shares of the best effect's gain that another on the same joint must reach to be preferred: one with fewer parameters, and
one with as many that acts nearer to the command."""

_FACTORS = (0.1, 10.0)
"""Range within which a candidate's size is guessed, in multiples of the size at which it was simulated."""


@dataclass(frozen=True)
class Look:
    """Change that a candidate makes beside some explanation.

    Args:
        candidate: The candidate.
        values: Parameters at which it was simulated.
        change: Change of the residuals of all records, in units of the noise. [sum of T C].
    """

    candidate: Candidate
    values: dict[str, float]
    change: Array

    def beside(self, basis: Array) -> Look:
        """Keep the part of the change that other effects cannot make: the part orthogonal to their derivatives.

        Args:
            basis: Orthonormal basis of the residual's derivatives by the parameters of the others. [sum of T C, P].
        """
        return replace(self, change=self.change - basis @ (basis.T @ self.change))

    def guess(self, row: Array) -> tuple[float, float]:
        """Compute the factor that fits a residual best, and by how much it then reduces the square. [sum of T C]."""
        along, size = float(self.change @ row), float(self.change @ self.change)
        if size <= 0.0:
            return 1.0, 0.0
        factor = 1.0 if self.candidate.effect.threshold else float(np.clip(along / size, *_FACTORS))
        return factor, 2.0 * factor * along - factor**2 * size

    def scaled(self, factor: float) -> dict[str, float]:
        """Return the parameters with the amplitudes times a factor."""
        out: dict[str, float] = self.candidate.effect.scaled(self.values, factor)
        return out


def key_of(candidate: Candidate, values: dict[str, float]) -> tuple[Candidate, tuple[float, ...]]:
    """Return the key under which a look is kept: one for all sizes, or one per size for an effect with a threshold."""
    return candidate, tuple(values.values()) if candidate.effect.threshold else ()


def plainest_first(found: list[tuple[float, Look]]) -> list[tuple[float, Look]]:
    """Move a plainer candidate that does about as well before the best one.

    An effect on the same joint is plainer if it has fewer parameters, or as many and acts nearer to the command. Of two effects
    that no motion tells apart, the same one is therefore always chosen.

    Args:
        found: Gains and looks, the largest gain first.
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
