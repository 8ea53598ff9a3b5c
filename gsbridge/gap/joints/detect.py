"""Detection of a discrepancy: statistics of residuals, calibrated on replicates without effects instead of by theory.

A replicate is the sum of white noise, scaled by the same estimate of its size as a record's; a random multiple of the change
by a finer time step; and slow deviations as large as the user tolerates, with random correlation times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from gsbridge.gap.diagnosis.closure import block_means
from gsbridge.gap.diagnosis.pvalues import tail_pvalue
from gsbridge.gap.joints.noise import white_noise
from gsbridge.gap.joints.residuals import JointResiduals
from gsbridge.gap.joints.screen import Screen
from gsbridge.geometry import Array

SCALES = (1, 4, 16, 64)
"""Lengths of the blocks over which residuals are averaged, samples. Effects last longer than noise and survive averaging."""

REPLICATES = 199
"""Number of replicates of the noise in a null distribution."""

COLOUR_RECORDS = 2
"""Number of records from which the size of coloured noise is estimated: `fit` and `select`."""

_UNSURE = 0.5
"""Standard deviation of the time step's error that remains after correction, in multiples of the change by a finer step."""


def excess(residual: Array) -> Array:
    """Compute how far squared residuals exceed those of white noise, in standard deviations.

    Args:
        residual: Whitened residual. [T, C].

    Returns:
        For each of the S `SCALES` that are no longer than the residual: the excess of each channel, then that of all channels.
        [S * (C + 1)].
    """
    out = []
    for scale in [scale for scale in SCALES if scale <= len(residual)]:
        squares = block_means(residual, scale) ** 2
        rows, count = squares.shape
        out.append((squares.sum(axis=0) - rows) / np.sqrt(2.0 * rows))
        out.append([(squares.sum() - rows * count) / np.sqrt(2.0 * rows * count)])
    return np.concatenate(out)


@dataclass(frozen=True)
class JointNull:
    """Null distribution of residuals without any effect.

    Args:
        excesses: Result of `excess` for each replicate. [R, S * (C + 1)].
        gains: Largest gain of any signature in each replicate; empty without a bank. [R].
        share: Mean square of one number of the replicates.
    """

    excesses: Array
    gains: Array
    share: float

    def statistic(self, residual: Array) -> float:
        """Compute a residual's largest excess over scales and channels, in standard deviations of the replicates. [T, C]."""
        return float(((excess(residual) - self._middle) / self._spread).max())

    @property
    def _middle(self) -> Array:
        return np.median(self.excesses, axis=0)

    @property
    def _spread(self) -> Array:
        return np.maximum(np.quantile(self.excesses, 0.975, axis=0) - self._middle, 1.0) / 1.96

    def p_value(self, residual: Array) -> float:
        """Compute the p-value of a residual's statistic among those of the replicates, by `tail_pvalue`. [T, C]."""
        replicas = ((self.excesses - self._middle) / self._spread).max(axis=1)
        return tail_pvalue(replicas, self.statistic(residual))

    def p_gain(self, gain: float) -> float:
        """Compute the probability that some signature gains as much by chance; 1 without a bank."""
        return tail_pvalue(self.gains, gain) if len(self.gains) else 1.0


def _estimated(view: JointResiduals, noise: Array) -> Array:
    """Estimate the noise of each channel as on a record: from neighbouring samples, or from all of it if it is coloured.

    [T, C] -> [C].
    """
    if view.colour is not None:
        return np.sqrt((view.coloured(noise) ** 2).mean(axis=0))
    return np.median([white_noise(noise[a:b]) for a, b in view.spans if b - a > 20] or [white_noise(noise)], axis=0)


def _slow(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Draw a slow deviation of unit size; its correlation time is random, from 4 samples to 4 times the record. [T, C]."""
    memory = np.exp(-1.0 / np.exp(rng.uniform(np.log(4.0), np.log(4.0 * shape[0]))))
    start = rng.standard_normal((1, shape[1]))
    return lfilter([np.sqrt(1 - memory**2)], [1, -memory], rng.standard_normal(shape), axis=0, zi=memory * start)[0]


def joint_null(
    view: JointResiduals, rng: np.random.Generator, screen: Screen | None = None, replicates: int = REPLICATES
) -> JointNull:
    """Draw replicates of a view's residual without effects.

    Args:
        view: The record, the mechanism that replays it, and the noise.
        rng: Random numbers.
        screen: Signatures whose largest gain in each replicate is computed, too; None to compute none.
        replicates: Number of replicates.
    """
    gap = view.stepping()
    shape = gap.shape
    declared = np.array([kind in view.record.sigma for kind, _ in view.channels])
    allowed = view.tolerance()
    noises = [rng.standard_normal(shape) for _ in range(replicates)]
    found = np.stack([_estimated(view, noise) for noise in noises])
    excesses, residuals = [], []
    for noise, own in zip(noises, found, strict=True):
        # Imitate the pooling over records: estimates of other replicates and channels stand for those of the other records.
        if view.colour is None:
            others = rng.choice(found.ravel(), (view.records - 1, shape[1]))
        else:
            # Draw per channel, since correlation times differ, and without the third record, which gives no estimate.
            others = found[rng.integers(replicates, size=(COLOUR_RECORDS - 1, shape[1])), np.arange(shape[1])]
            own = found[rng.integers(replicates, size=shape[1]), np.arange(shape[1])]
        size = np.sqrt((np.vstack([own[None], others]) ** 2).mean(axis=0))
        residual = view.project(noise / np.where(declared, np.maximum(size, 1.0), size)) + rng.normal(0.0, _UNSURE) * gap
        if allowed.any():
            residual = residual + view.project(allowed * _slow(shape, rng))
        excesses.append(excess(residual))
        residuals.append(residual)
    stack = np.stack(residuals, axis=-1)
    gains = np.zeros(0 if screen is None else replicates)
    if screen is not None and len(screen.sizes):
        gains = screen.gains((screen.shapes @ stack.reshape(-1, replicates).astype(np.float32)).astype(np.float64))[0].max(
            axis=0
        )
    return JointNull(np.stack(excesses), gains, float((stack**2).mean()))
