"""Noise of the benchmark's sensors: white noise, as the diagnosis expects, and kinds that it is not told about."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from gsbridge.geometry import Array

NOISES = ("white", "coloured", "heavy", "understated", "quantised")
"""Kinds of noise: white normal noise; correlated between neighbouring samples; with outliers (Student's t with five degrees of
freedom); white, but stated too small in the case file; rounded to steps of two standard deviations."""

MEMORY = (0.4, 0.85)
"""Range of the correlation of neighbouring samples of coloured noise."""

STATED = 1.0 / 1.5
"""Stated share of the true noise in cases with understated noise."""


def spoiled(clean: Array, sigma: Array, kind: str, rng: np.random.Generator) -> Array:
    """Add noise to measurements.

    Args:
        clean: Values without noise. [T, N].
        sigma: Standard deviation of each column's noise. [N].
        kind: One of `NOISES`; `understated` is `white` here.
        rng: Random numbers.

    Returns:
        Values with noise. [T, N].
    """
    shape = clean.shape
    if kind == "coloured":
        memory = rng.uniform(*MEMORY)
        fresh = rng.standard_normal((shape[0] + 100, *shape[1:])) * np.sqrt(1 - memory**2)
        return clean + sigma * lfilter([1.0], [1.0, -memory], fresh, axis=0)[100:]
    if kind == "heavy":
        return clean + sigma * rng.standard_t(5, shape) / np.sqrt(5 / 3)
    noisy = clean + sigma * rng.standard_normal(shape)
    if kind == "quantised":
        return np.round(noisy / (2 * sigma)) * (2 * sigma)
    return noisy
