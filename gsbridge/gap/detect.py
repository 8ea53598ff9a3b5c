"""Is there a discrepancy at all: statistics of residuals, calibrated by effect-free replicates instead of by theory.

Replicates hold white noise that passed the same estimate of its size, and by how much another step of time changes the replay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gsbridge.gap.bank import Bank
from gsbridge.gap.replay import Mechanism
from gsbridge.gap.view import View, build_setup, white_noise
from gsbridge.geometry import Array

SCALES = (1, 4, 16, 64)
"""Lengths of the blocks over which residuals are averaged, samples: an effect lasts longer than noise."""

REPLICATES = 199
"""p-values down to 1/200."""


def block_means(residual: Array, scale: int) -> Array:
    """Means over blocks, times the root of their length, so that white noise keeps its size. [T, C] -> [T // scale, C]."""
    rows = len(residual) // scale
    return residual[: rows * scale].reshape(rows, scale, -1).sum(axis=1) / np.sqrt(scale)


def excess(residual: Array) -> Array:
    """By how many standard deviations squared residuals exceed white noise: for every scale, of each channel and of all.

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
class Null:
    """How effect-free residuals look.

    Args:
        excesses: Of the replicates. [R, S * (C + 1)].
        gains: Largest gain of any signature in each replicate; empty without a bank. [R].
        share: Mean squared residual of one number.
    """

    excesses: Array
    gains: Array
    share: float

    def statistic(self, residual: Array) -> float:
        """One figure of a residual: its largest excess among scales and channels, in spreads of the replicates."""
        return float(((excess(residual) - self._middle) / self._spread).max())

    @property
    def _middle(self) -> Array:
        return np.median(self.excesses, axis=0)

    @property
    def _spread(self) -> Array:
        return np.maximum(np.quantile(self.excesses, 0.975, axis=0) - self._middle, 1.0) / 1.96

    def p_value(self, residual: Array) -> float:
        """Share of replicates at least as large."""
        replicas = ((self.excesses - self._middle) / self._spread).max(axis=1)
        return float((1 + (replicas >= self.statistic(residual)).sum()) / (1 + len(replicas)))

    def p_gain(self, gain: float) -> float:
        """Share of replicates in which some signature gains as much by chance."""
        return float((1 + (self.gains >= gain).sum()) / (1 + len(self.gains)))


def stepping_gap(view: View) -> Array:
    """What another step of time changes in the nominal replay, SI units. [T, C].

    Engines differ by about as much: each takes speeds or positions of the begin or the end of a step.
    """
    system = view.mechanism.system
    fine = Mechanism(replace(system, physics_rate=4 * system.physics_rate))
    other = fine.run(view.record, build_setup(fine, ()), view.spans, view.states)
    return view.stack(other) - view.stack(view.simulate())


def calibrate(view: View, rng: np.random.Generator, bank: Bank | None = None, replicates: int = REPLICATES) -> Null:
    """Draw effect-free replicates of a view's residual."""
    gap = view.whiten(stepping_gap(view))
    shape = gap.shape
    declared = np.array([kind in view.record.sigma for kind, _ in view.channels])
    excesses, residuals = [], []
    for _ in range(replicates):
        noise = rng.standard_normal(shape)
        size = np.median([white_noise(noise[a:b]) for a, b in view.spans if b - a > 20] or [white_noise(noise)], axis=0)
        residual = view.project(noise / np.where(declared, 1.0, size)) + rng.normal(0.0, 1.5) * gap
        excesses.append(excess(residual))
        residuals.append(residual.ravel())
    stack = np.stack(residuals, axis=1)
    gains = np.zeros(0 if bank is None else replicates)
    for signature in () if bank is None else bank.signatures:
        shape_of = view.whiten(signature.change.astype(np.float64)).ravel()
        size = float(shape_of @ shape_of)
        if size > 0.0:
            along = shape_of @ stack
            factor = np.clip(along / size, 0.4, 2.5)
            gains = np.maximum(gains, 2 * factor * along - factor**2 * size)
    return Null(np.stack(excesses), gains, float((stack**2).mean()))
