"""Do photos differ by more than noise? Sums over blocks of pixels, calibrated by photos of one day."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from gsbridge.gap.diagnosis.pvalues import tail_pvalue
from gsbridge.gap.image.residuals import ImageResiduals
from gsbridge.geometry import Array

SCALES = (1, 2, 4, 8, 16)
"""Edges of blocks, pixels as compared: each twice the one before, whose blocks it joins."""

REPLICATES = 199

_FILLED = 0.5
"""Share of a block that must be compared for its mean to count."""


Filled = tuple[list[Array], list[Array]]
"""Pixels that are compared in each block, by scale: of single photos, and of what all have in common."""


def filled_blocks(view: ImageResiduals) -> Filled:
    """How far blocks are filled, which is the same for all residuals of a view."""
    count = view.mask.sum(axis=0)[None, ..., None]
    return _blocks(view.mask[..., None]), _blocks((count > 0).astype(np.float32))


def sums(view: ImageResiduals, table: Array, filled: Filled | None = None) -> Array:
    """Squares of a residual and of its means over blocks, of each photo and of what all have in common. [K].

    Every colour by itself and their sum, at every scale; then the noise: of classes, of their means over photos, of all.

    Args:
        view: The photos that the residual belongs to.
        table: Residuals, as from `ImageResiduals.residual`. [N * h + N, 3 * w].
        filled: What `filled_blocks` gave, where it is known; None computes it. [N, h, w, 1] and [1, h, w, 1] at each scale.
    """
    white = view.pictures(table)
    # Most effects stay where they are in the image, or change all of it.
    count = view.mask.sum(axis=0)[None, ..., None]
    common = white.sum(axis=0)[None] / np.sqrt(np.maximum(count, 1.0))
    out = []
    for values, weights in zip((white, common), filled or filled_blocks(view), strict=True):
        values = np.concatenate([values, values.sum(axis=-1, keepdims=True) / np.sqrt(3.0)], axis=-1)
        for scale, total, weight in zip(SCALES, _blocks(values), weights, strict=True):
            means = np.where(weight >= _FILLED * scale**2, total / np.sqrt(np.maximum(weight, 1.0)), 0.0)
            out.append((means.astype(np.float64) ** 2).sum(axis=(0, 1, 2)))
    grain = view.noise_part(table).astype(np.float64)
    measured = np.maximum((grain != 0).sum(axis=0), 1)
    mean = grain.sum() ** 2 / max(int((grain != 0).sum()), 1)
    out.append(np.array([(grain**2).sum(), (grain.sum(axis=0) ** 2 / measured).sum(), mean]))
    return np.concatenate(out)


def _blocks(values: Array) -> list[Array]:
    """Sums over blocks of each of `SCALES`; the image is filled up with zeros. [N, h, w, C] -> [N, h / scale, w / scale, C]."""
    out = [values]
    for _ in SCALES[1:]:
        values = out[-1]
        odd = [(0, 0), (0, values.shape[1] % 2), (0, values.shape[2] % 2), (0, 0)]
        values = np.pad(values, odd) if values.shape[1] % 2 or values.shape[2] % 2 else values
        values = values[:, 0::2] + values[:, 1::2]
        out.append(values[:, :, 0::2] + values[:, :, 1::2])
    return out


@dataclass(frozen=True)
class ImageNull:
    """Null distribution of photos in which nothing has changed.

    Args:
        sums: Sums over each replicate, as from the function `sums`. [R, K].
    """

    sums: Array

    @classmethod
    def of(cls, view: ImageResiduals, rng: np.random.Generator, replicates: int = REPLICATES) -> ImageNull:
        """Draw replicates of the noise of one role's views.

        Args:
            view: Photos of the role and the noise.
            rng: Random numbers.
            replicates: How many to draw.
        """
        filled = filled_blocks(view)
        return cls(np.stack([sums(view, view.replicate(rng), filled) for _ in range(replicates)]))

    def p_value(self, view: ImageResiduals, table: Array) -> float:
        """Probability that noise alone makes a residual as large as this somewhere. [N * h + N, 3 * w]."""
        replicas = self._surprise(self.sums).max(axis=1)
        return tail_pvalue(replicas, float(self._surprise(sums(view, table)).max()))

    def _surprise(self, found: Array) -> Array:
        """Minus the logarithm of the chance of each sum: some are of one square, others of thousands, and those of few have
        longer tails. Sums of squares are taken for chi-squared ones of the replicates' means and spreads. [..., K].

        Source: Satterthwaite, Biometrics Bulletin 2, 1946.
        """
        mean, variance = self.sums.mean(axis=0), self.sums.var(axis=0)
        counted = (mean > 0) & (variance > 0)
        mean, variance = np.where(counted, mean, 1.0), np.where(counted, variance, 2.0)
        return np.where(counted, -chi2.logsf(found * 2.0 * mean / variance, 2.0 * mean**2 / variance), 0.0)
