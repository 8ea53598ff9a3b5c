"""Test whether photos differ by more than noise: sums of squares over blocks of pixels, calibrated by replicates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from gsbridge.gap.diagnosis.pvalues import tail_pvalue
from gsbridge.gap.image.residuals import ImageResiduals
from gsbridge.geometry import Array

SCALES = (1, 2, 4, 8, 16)
"""Edges of blocks, in compared pixels; each block joins four of the next smaller ones."""

REPLICATES = 199

_FILLED = 0.5
"""Share of a block that must be compared for its mean to count."""


_INDEPENDENT = 0.01
"""p-value of the difference of repeated photos from which on patches of pixels are taken to have independent noise."""

Filled = tuple[list[Array], list[Array]]
"""Number of compared pixels in each block, by scale: for single photos, and for the sum over photos."""


def filled_blocks(view: ImageResiduals) -> Filled:
    """Count the compared pixels in each block; the counts are the same for all residuals of a view."""
    count = view.mask.sum(axis=0)[None, ..., None]
    return _blocks(view.mask[..., None]), _blocks((count > 0).astype(np.float32))


def sums(view: ImageResiduals, table: Array, filled: Filled | None = None) -> Array:
    """Return the test statistics of a residual: sums of squares of normalised block means at all scales. [K].

    First for single photos, then for the sum over photos: at every scale, one for each colour and one for the sum of colours.
    Then for the noise part: all values, means over photos, and the overall mean.

    Args:
        view: The views that the residual belongs to.
        table: Residual, as from `ImageResiduals.residual`. [N * h + N, 3 * w].
        filled: Result of `filled_blocks`, to save time; None computes it. [N, h, w, 1] and [1, h, w, 1] at each scale.
    """
    white = view.pictures(table)
    # The sum over photos is sensitive to effects that are fixed in the image or change all of it, as most do.
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
    """Sum over blocks of each of `SCALES`, padding with zeros. [N, h, w, C] -> [N, h / scale, w / scale, C] each."""
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
        sums: Test statistics of each replicate, as from the function `sums`. [R, K].
        white: Their expectation for white noise. [K].
    """

    sums: Array
    white: Array

    @classmethod
    def of(
        cls,
        view: ImageResiduals,
        rng: np.random.Generator,
        replicates: int = REPLICATES,
        patches: Sequence[int] = SCALES,
    ) -> ImageNull:
        """Draw replicates of the residual of one role's views with nothing changed.

        Neighbouring pixels of compressed or denoised photos share noise. Signs are therefore drawn for patches of pixels, the
        smallest for which the difference of repeated photos is itself no surprise.

        Args:
            view: Residuals on the views of the role.
            rng: Random numbers.
            replicates: Number of replicates to draw.
            patches: Edges of patches to try, ascending, in compared pixels; the last is taken where none is large enough.
        """
        filled = filled_blocks(view)
        counts = [(weight >= _FILLED * scale**2).sum() for part in filled for scale, weight in zip(SCALES, part, strict=True)]
        # Three colours and their sum at each scale. The part about the photos' noise is never free of noise.
        white = np.concatenate([np.repeat(counts, 4), np.zeros(3)]).astype(np.float64)
        usual = view.usual_table()
        for patch in patches:
            null = cls(np.stack([sums(view, view.replicate(rng, patch), filled) for _ in range(replicates)]), white)
            if patch == patches[-1] or null.p_value(view, usual) >= _INDEPENDENT:
                break
        return null

    def p_value(self, view: ImageResiduals, table: Array) -> float:
        """Return the probability that noise alone gives a largest statistic as extreme as here. [N * h + N, 3 * w]."""
        replicas = self._surprise(self.sums).max(axis=1)
        return tail_pvalue(replicas, float(self._surprise(sums(view, table)).max()))

    def _surprise(self, found: Array) -> Array:
        """Return minus the log p-value of each sum of squares, so that sums of few and many squares compare. [..., K].

        Each sum is taken as a scaled chi-squared variable with the mean and variance of the replicates. Repeated photos without
        any difference have no replicates to compare with; white noise stands in for them.

        Source: Satterthwaite, Biometrics Bulletin 2, 1946.
        """
        mean, variance = self.sums.mean(axis=0), self.sums.var(axis=0)
        counted = (mean > 0) & (variance > 0)
        mean = np.where(counted, mean, np.maximum(self.white, 1.0))
        variance = np.where(counted, variance, 2.0 * mean)
        surprise = -chi2.logsf(found * 2.0 * mean / variance, 2.0 * mean**2 / variance)
        return np.where(counted | (self.white > 0), surprise, 0.0)
