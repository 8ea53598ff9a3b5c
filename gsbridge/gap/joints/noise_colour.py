"""Coloured noise: an autoregressive model of it, and a test whether a residual may be such noise.

A filter in a sensor, or in the driver that reads it, makes noise that differences of neighbouring samples underestimate. Such
noise is correlated over a fraction of a second only, and not with the motion; the residual of a missing effect is neither.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from gsbridge.geometry import Array

_ORDER = 2
"""Order of the autoregressive law: it approximates noise behind a filter of first order, with white noise added to it."""

_LONGEST = 0.1
"""Longest time constant of coloured noise, s: its autocorrelation has fallen to 1/e then. Arms move more slowly."""

_SLIGHT = 1.2
"""Root mean square residual over all channels up to which colour does not matter, in units of the noise that neighbouring
samples show."""


_Act = Callable[[Array, Array, float], Array]


@dataclass(frozen=True)
class NoiseColour:
    """An autoregressive law of each channel's noise, of unit variance.

    Args:
        coefficients: Coefficients of the samples before, the nearest first. [P, C].
        innovation: Standard deviation of the part that the samples before do not predict. [C].
        samples: Number of samples of each channel to which the law was fitted.

    Source: Box and Jenkins, Time Series Analysis, 1970.
    """

    coefficients: Array
    innovation: Array
    samples: int

    @classmethod
    def of(cls, parts: Sequence[Array]) -> NoiseColour:
        """Fit the law to stretches of noise by the Yule-Walker equations. [T, C] each."""
        lags = np.stack(
            [sum((part[lag:] * part[: len(part) - lag]).sum(axis=0) for part in parts) for lag in range(_ORDER + 1)]
        )
        lags = lags / np.maximum(lags[0], 1e-300)
        coefficients = np.stack([solve_toeplitz(lags[:-1, c], lags[1:, c]) for c in range(lags.shape[1])], axis=1)
        return cls(coefficients, np.sqrt(np.maximum(1.0 - (coefficients * lags[1:]).sum(axis=0), 1e-12)), sum(map(len, parts)))

    @property
    def memory(self) -> Array:
        """Number of samples after which the autocorrelation of each channel's noise has fallen to 1/e. [C]."""
        return _samples(self._roots())

    @property
    def least_memory(self) -> Array:
        """Lower bound of `memory`, by two standard deviations of its estimate from so many samples. [C]."""
        roots = self._roots()
        return _samples(roots - 2.0 * np.sqrt((1.0 - np.minimum(roots, 1.0) ** 2) / max(self.samples, 1)))

    def _roots(self) -> Array:
        """Compute the factor by which the autocorrelation decays per sample in the long run. [C]."""
        return np.stack([np.abs(np.roots([1.0, *-column])).max() for column in self.coefficients.T])

    @property
    def steady(self) -> Array:
        """Gain of `whiten` at a constant value. [C]."""
        return (1.0 - self.coefficients.sum(axis=0)) / self.innovation

    def whiten(self, values: Array) -> Array:
        """Take off what the samples before predict, and scale such noise to unit variance. [T, C] of one stretch."""
        return self._each(values, lambda column, taps, size: lfilter(taps, [size], column))

    def colour(self, values: Array) -> Array:
        """Invert `whiten`. [T, C] of one stretch."""
        return self._each(values, lambda column, taps, size: lfilter([size], taps, column))

    def _each(self, values: Array, act: _Act) -> Array:
        out = np.empty_like(values)
        for c, column in enumerate(values.T):
            out[:, c] = act(column, np.concatenate([[1.0], -self.coefficients[:, c]]), float(self.innovation[c]))
        return out


def _samples(roots: Array) -> Array:
    """Compute the number of samples after which a factor per sample has multiplied to 1/e."""
    return -1.0 / np.log(np.clip(roots, 1e-12, 1.0 - 1e-12))


def forgetful(colour: NoiseColour, sizes: Array, period: float) -> bool:
    """Tell whether a residual may be noise of a filter: larger than neighbouring samples show, with a short memory.

    Args:
        colour: Autoregressive law of the residual.
        sizes: Root mean square of the residual, in units of the noise that neighbouring samples show. [C].
        period: Time between two samples, s.
    """
    large = float(np.sqrt((sizes**2).mean())) > _SLIGHT
    return large and bool((colour.least_memory * period <= _LONGEST).all())
