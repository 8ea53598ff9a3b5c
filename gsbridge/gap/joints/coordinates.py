"""Coordinates in which a fit moves: the parameters of effects, or the products of a shape and the amplitude that weights it.

A mass at a place pulls with the product of the two, a moment. A record determines the moment well, but hardly which mass and
place it comes from. Parameters that fit lie along a hyperbola, on which straight steps make no progress. With the product as a
coordinate, they lie on a line.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsbridge.gap.diagnosis.results import Candidate
from gsbridge.geometry import Array

_LEAST = 1e-3
"""Least factor of a shape, as a share of the typical amplitude: it keeps the shape finite when the amplitude goes to zero."""

_ROUNDING = 1e-12
"""Distance from a bound, as a share of it, within which a parameter is set onto the bound."""


class Coordinates:
    """Parameters of several candidates as one vector, with bounds and scales, and the coordinates of their fit.

    Args:
        who: The candidates.
        weighted: Whether the coordinate of a shape is its product with the amplitude that weights it; if not, all coordinates
            are the parameters themselves.
    """

    def __init__(self, who: Sequence[Candidate], weighted: bool = True) -> None:
        parameters = [p for candidate in who for p in candidate.effect.parameters]
        self._low, self._high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
        # Smallest scale: a fiftieth of the typical amplitude, or a tenth of a shape's range.
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
        """Compute the factor of each parameter, 1 for most, from parameters or coordinates alike. [P] -> [P]."""
        out = np.ones(len(self))
        for shape, amplitude in self._pairs:
            out[shape] = max(abs(vector[amplitude]), self._floor[amplitude])
        return out

    def of(self, parameters: Array) -> Array:
        """Convert parameters to coordinates. [P] -> [P]."""
        return parameters * self.factors(parameters)

    def parameters(self, vector: Array) -> Array:
        """Convert coordinates to parameters. [P] -> [P]."""
        out = vector / self.factors(vector)
        # Dividing the product again may leave a parameter beyond its bound by a rounding error, which no model accepts.
        for bound in (self._low, self._high) if self._pairs else ():
            out = np.where(np.abs(out - bound) <= _ROUNDING * np.abs(bound), bound, out)
        return out

    def slopes(self, vector: Array) -> Array:
        """Compute the derivatives of the parameters by the coordinates. [P, P]."""
        factors = self.factors(vector)
        out = np.diag(1.0 / factors)
        for shape, amplitude in self._pairs:
            if abs(vector[amplitude]) > self._floor[amplitude]:
                out[shape, amplitude] = -vector[shape] / (factors[shape] * vector[amplitude])
        return out

    def bounds(self, vector: Array) -> tuple[Array, Array]:
        """Compute the lowest and highest coordinates; those of products hold at the present amplitudes. [P] each."""
        factors = self.factors(vector)
        return self._low * factors, self._high * factors

    def within(self, vector: Array, kept: bool = True) -> Array:
        """Move coordinates to nearby ones whose parameters lie within their bounds. [P] -> [P].

        Args:
            vector: Coordinates. [P].
            kept: What to do if a shape lies out of bounds. If true, keep the product, which records mostly determine, and let
                the amplitude grow; otherwise change the product.
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
        """Compute the typical step of each coordinate. [P]."""
        return np.maximum(np.abs(vector), self._grain * self.factors(vector))
