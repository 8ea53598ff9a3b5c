"""Coordinates in which a fit moves: the parameters of effects, or their products with what weighs them.

A mass at a place pulls with the product of the two, a moment, which a record tells well; which of many masses and places it is,
it hardly tells. Parameters that fit lie along a hyperbola, where straight steps get nowhere. In the product they lie on a line.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.geometry import Array

_LEAST = 1e-3
"""Share of a typical amplitude below which it no longer weighs a shape, so that the shape stays finite."""

_ROUNDING = 1e-12
"""Share of a bound within which a parameter lies on it."""


class Coordinates:
    """Parameters of several candidates as one vector, with bounds and scales, and the coordinates of their fit.

    Args:
        who: The candidates.
        weighted: Whether shapes move as their products with what weighs them; otherwise the coordinates are the parameters.
    """

    def __init__(self, who: Sequence[Candidate], weighted: bool = True) -> None:
        parameters = [p for candidate in who for p in candidate.effect.parameters]
        self._low, self._high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
        # Amplitudes are looked at down to a fiftieth of a typical one, shapes in tenths of their range.
        self._grain = np.array([0.02 * p.typical if p.amplitude else p.grain or 0.1 * (p.high - p.low) for p in parameters])
        self._pairs: list[tuple[int, int]] = []
        self._floor = np.array([_LEAST * abs(p.typical) for p in parameters])
        first = 0
        for candidate in who:
            names = [p.name for p in candidate.effect.parameters]
            for k, p in enumerate(candidate.effect.parameters):
                if weighted and p.weighted_by:
                    self._pairs.append((first + k, first + names.index(p.weighted_by)))
            first += len(names)

    def __len__(self) -> int:
        return len(self._low)

    def factors(self, vector: Array) -> Array:
        """What each parameter is multiplied by, 1 for most; from parameters or coordinates. [P] -> [P]."""
        out = np.ones(len(self))
        for shape, amplitude in self._pairs:
            out[shape] = max(abs(vector[amplitude]), self._floor[amplitude])
        return out

    def of(self, parameters: Array) -> Array:
        """Coordinates of parameters. [P] -> [P]."""
        return parameters * self.factors(parameters)

    def parameters(self, vector: Array) -> Array:
        """Parameters at some coordinates. [P] -> [P]."""
        out = vector / self.factors(vector)
        # A product of a bound, divided, may lie a rounding beyond it, where no model may be.
        for bound in (self._low, self._high) if self._pairs else ():
            out = np.where(np.abs(out - bound) <= _ROUNDING * np.abs(bound), bound, out)
        return out

    def slopes(self, vector: Array) -> Array:
        """Derivatives of the parameters by the coordinates. [P, P]."""
        factors = self.factors(vector)
        out = np.diag(1.0 / factors)
        for shape, amplitude in self._pairs:
            if abs(vector[amplitude]) > self._floor[amplitude]:
                out[shape, amplitude] = -vector[shape] / (factors[shape] * vector[amplitude])
        return out

    def bounds(self, vector: Array) -> tuple[Array, Array]:
        """Lowest and highest coordinates, of products at the present amplitudes. [P] each."""
        factors = self.factors(vector)
        return self._low * factors, self._high * factors

    def within(self, vector: Array, kept: bool = True) -> Array:
        """Coordinates near to some whose parameters make sense. [P] -> [P].

        Args:
            vector: Coordinates. [P].
            kept: Whether a product is kept where its shape would lie out of bounds, and its amplitude grows, since records
                mostly tell products; otherwise the product gives way.
        """
        out = vector.copy()
        for shape, amplitude in self._pairs if kept else ():
            most = self._high[shape] if vector[shape] > 0.0 else -self._low[shape]
            if most <= 0.0:
                continue
            own = np.clip(out[amplitude], self._low[amplitude], self._high[amplitude])
            least = min(abs(vector[shape]) / most, self._high[amplitude])
            out[amplitude] = own if abs(own) >= least else least if own >= 0.0 else max(-least, self._low[amplitude])
        return self.of(np.clip(self.parameters(out), self._low, self._high))

    def scale(self, vector: Array) -> Array:
        """Scales on which the coordinates move. [P]."""
        return np.maximum(np.abs(vector), self._grain * self.factors(vector))
