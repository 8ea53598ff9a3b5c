"""Is there a discrepancy at all: statistics of residuals, calibrated by effect-free replicates instead of by theory.

Replicates hold white noise that passed the same estimate of its size, by how much another step of time changes the replay, and
what the user tolerates: slow deviations of all colours.
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
"""Lengths of the blocks over which residuals are averaged, samples: an effect lasts longer than noise."""

REPLICATES = 199
"""Replicates of the noise that a null distribution is made of."""

COLOUR_RECORDS = 2
"""Records that tell the size of noise whose neighbouring samples are alike: `fit` and `select`."""

_UNSURE = 0.5
"""Spread, in multiples of what a finer step changes, of what is left of the step's error after it was taken off."""


def excess(residual: Array) -> Array:
    """How far squared residuals exceed white noise, in standard deviations: for every scale, of each channel and of all.

    Args:
        residual: Whitened. [T, C].

    Returns:
        [S * (C + 1)].
    """
    out = []
    for scale in SCALES:
        squares = block_means(residual, scale) ** 2
        rows, count = squares.shape
        out.append((squares.sum(axis=0) - rows) / np.sqrt(2.0 * rows))
        out.append([(squares.sum() - rows * count) / np.sqrt(2.0 * rows * count)])
    return np.concatenate(out)


@dataclass(frozen=True)
class JointNull:
    """Null distribution of residuals without any effect.

    Args:
        excesses: What `excess` gives for each replicate. [R, S * (C + 1)].
        gains: Largest gain of any signature in each replicate; empty without a bank. [R].
        share: Mean squared residual of one number.
    """

    excesses: Array
    gains: Array
    share: float

    def statistic(self, residual: Array) -> float:
        """Largest excess of a residual among scales and channels, in standard deviations of the replicates. [T, C]."""
        return float(((excess(residual) - self._middle) / self._spread).max())

    @property
    def _middle(self) -> Array:
        return np.median(self.excesses, axis=0)

    @property
    def _spread(self) -> Array:
        return np.maximum(np.quantile(self.excesses, 0.975, axis=0) - self._middle, 1.0) / 1.96

    def p_value(self, residual: Array) -> float:
        """P-value of a residual's statistic among those of the replicates, by `tail_pvalue`. [T, C]."""
        replicas = ((self.excesses - self._middle) / self._spread).max(axis=1)
        return tail_pvalue(replicas, self.statistic(residual))

    def p_gain(self, gain: float) -> float:
        """Share of replicates in which some signature gains as much by chance; 1 without a bank."""
        return tail_pvalue(self.gains, gain) if len(self.gains) else 1.0


def _estimated(view: JointResiduals, noise: Array) -> Array:
    """Noise of each channel as it is found on a record: by neighbouring samples, or as a whole where they are alike.

    [T, C] -> [C].
    """
    if view.colour is not None:
        return np.sqrt((view.coloured(noise) ** 2).mean(axis=0))
    return np.median([white_noise(noise[a:b]) for a, b in view.spans if b - a > 20] or [white_noise(noise)], axis=0)


def _slow(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """A slow deviation of unit size, of a memory drawn between a few samples and the whole record. [T, C]."""
    memory = np.exp(-1.0 / np.exp(rng.uniform(np.log(4.0), np.log(4.0 * shape[0]))))
    start = rng.standard_normal((1, shape[1]))
    return lfilter([np.sqrt(1 - memory**2)], [1, -memory], rng.standard_normal(shape), axis=0, zi=memory * start)[0]


def joint_null(
    view: JointResiduals, rng: np.random.Generator, screen: Screen | None = None, replicates: int = REPLICATES
) -> JointNull:
    """Draw effect-free replicates of a view's residual.

    Args:
        view: The record, the mechanism that replays it, and the noise.
        rng: Random numbers.
        screen: Signatures whose largest gain by chance is drawn, too; none when None.
        replicates: How many to draw.
    """
    gap = view.stepping()
    shape = gap.shape
    declared = np.array([kind in view.record.sigma for kind, _ in view.channels])
    allowed = view.tolerance()
    noises = [rng.standard_normal(shape) for _ in range(replicates)]
    found = np.stack([_estimated(view, noise) for noise in noises])
    excesses, residuals = [], []
    for noise, own in zip(noises, found, strict=True):
        # Other records' estimates are as good as those of other replicates and channels.
        if view.colour is None:
            others = rng.choice(found.ravel(), (view.records - 1, shape[1]))
        else:
            # Each channel has a memory of its own, and the third record tells nothing of its size.
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
