"""Noise whose neighbouring samples are alike: what it is taken for, and when what an explanation leaves may be taken for it.

A filter in a sensor, or in the driver that reads it, makes noise that differences of neighbouring samples show too small. Such
noise forgets itself within a fraction of a second and has no share in the motion; what a missing effect leaves does neither.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from gsbridge.geometry import Array

_ORDER = 2
"""Samples before one that tell it: a filter of first order, and white noise on top of what it lets through."""

_LONGEST = 0.1
"""Longest time, s, after which noise has forgotten itself to 1/e: arms move more slowly."""

_SLIGHT = 1.2
"""Multiple of the noise that neighbouring samples show, over all channels, up to which its colour does not matter."""


_Act = Callable[[Array, Array, float], Array]


@dataclass(frozen=True)
class NoiseColour:
    """An autoregressive law of each channel's noise, of unit variance.

    Args:
        coefficients: Of the samples before one, the nearest first. [P, C].
        innovation: Standard deviation of what those do not tell. [C].
        samples: Samples of each channel that it was fitted to.

    Source: Box and Jenkins, Time Series Analysis, 1970.
    """

    coefficients: Array
    innovation: Array
    samples: int

    @classmethod
    def of(cls, parts: Sequence[Array]) -> NoiseColour:
        """Fit the law to stretches of noise of unit variance, by Yule's and Walker's equations. [T, C] each."""
        lags = np.stack(
            [sum((part[lag:] * part[: len(part) - lag]).sum(axis=0) for part in parts) for lag in range(_ORDER + 1)]
        )
        lags = lags / np.maximum(lags[0], 1e-300)
        coefficients = np.stack([solve_toeplitz(lags[:-1, c], lags[1:, c]) for c in range(lags.shape[1])], axis=1)
        return cls(coefficients, np.sqrt(np.maximum(1.0 - (coefficients * lags[1:]).sum(axis=0), 1e-12)), sum(map(len, parts)))

    @property
    def memory(self) -> Array:
        """Samples after which the noise of each channel has forgotten itself to 1/e. [C]."""
        return _samples(self._roots())

    @property
    def least_memory(self) -> Array:
        """The same, as short as so many samples allow, by two standard deviations. [C]."""
        roots = self._roots()
        return _samples(roots - 2.0 * np.sqrt((1.0 - np.minimum(roots, 1.0) ** 2) / max(self.samples, 1)))

    def _roots(self) -> Array:
        """How much of the noise is left from sample to sample in the long run. [C]."""
        return np.stack([np.abs(np.roots([1.0, *-column])).max() for column in self.coefficients.T])

    @property
    def steady(self) -> Array:
        """What `whiten` makes of one that lasts. [C]."""
        return (1.0 - self.coefficients.sum(axis=0)) / self.innovation

    def whiten(self, values: Array) -> Array:
        """What the samples before do not tell of each, of unit variance for such noise. [T, C] of one stretch."""
        return self._each(values, lambda column, taps, size: lfilter(taps, [size], column))

    def colour(self, values: Array) -> Array:
        """The inverse of `whiten`. [T, C] of one stretch."""
        return self._each(values, lambda column, taps, size: lfilter([size], taps, column))

    def _each(self, values: Array, act: _Act) -> Array:
        out = np.empty_like(values)
        for c, column in enumerate(values.T):
            out[:, c] = act(column, np.concatenate([[1.0], -self.coefficients[:, c]]), float(self.innovation[c]))
        return out


def _samples(roots: Array) -> Array:
    """Samples in which a power of a number falls to 1/e."""
    return -1.0 / np.log(np.clip(roots, 1e-12, 1.0 - 1e-12))


def forgetful(colour: NoiseColour, sizes: Array, period: float) -> bool:
    """Whether a law is one of noise that a filter makes: larger than neighbouring samples show, and soon forgotten.

    Args:
        colour: The law.
        sizes: Root mean squares of what is left, in units of the noise that neighbouring samples show. [C].
        period: Time between two samples, s.
    """
    large = float(np.sqrt((sizes**2).mean())) > _SLIGHT
    return large and bool((colour.least_memory * period <= _LONGEST).all())
